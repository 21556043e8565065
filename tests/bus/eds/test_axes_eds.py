"""cia402_axes.eds is made from cia402.eds, and an EDS reader of others has the axes 800h apart."""

from __future__ import annotations

import canopen
import pytest
from bench.axes_eds import axes_eds

from palpate_bus.eds.check import check_file
from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.eds.cia402_axes import CIA402_AXES_EDS, axes_dictionary


def test_the_file_is_what_the_script_makes():
    """python -m bench.axes_eds"""
    assert CIA402_AXES_EDS.read_text() == axes_eds()


def test_it_keeps_the_rules():
    assert list(check_file(CIA402_AXES_EDS)) == []


@pytest.mark.parametrize("axis", range(8))
def test_each_axis_has_every_object_of_the_drive(axis):
    drive = canopen.import_od(str(CIA402_EDS), 5)
    node = canopen.import_od(str(CIA402_AXES_EDS), 5)
    for index in (index for index in drive if index >= 0x6000):
        own, profile = node[index + 0x800 * axis], drive[index]
        assert own.name == f"Axis {axis} {profile.name[0].lower()}{profile.name[1:]}"
        if isinstance(profile, canopen.objectdictionary.ODVariable):
            assert (own.data_type, own.access_type, own.default) == (
                profile.data_type,
                profile.access_type,
                profile.default,
            )
    assert node[0x67FF + 0x800 * axis].default == 0x40192


def test_its_pdos_are_off_and_cannot_be_enabled_without_can_fd():
    """Bit 31 of each COB-ID; a classic frame has no place for two axes with their state."""
    od = axes_dictionary(5)
    for index, cob_id in ((0x1400, 0x205), (0x1800, 0x4000_0185), (0x1801, 0x4000_0285)):
        assert od.default_number(index, 1) == 1 << 31 | cob_id
