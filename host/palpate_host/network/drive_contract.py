"""Objects that a CiA 402 drive has to agree in before it is started: COB-ID and mapping of its PDOs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from palpate_bus.eds.cia402 import CIA402_EDS, MODE_DISPLAY
from palpate_bus.eds.cia402_axes import (
    axes_dictionary,
    axes_of_tpdos,
    axis_key,
    command_words,
    state_words,
)
from palpate_edge.node.eds import load_eds
from palpate_edge.node.pdo_codec import PdoDirection
from palpate_host.common.joint_command import Follows
from palpate_host.drives.cia402_modes import COMMAND_MAPPING, MODES_BEST_FIRST
from palpate_host.network.node_contract import Wanted, mapping_of, pdos_of

COMMAND_RPDO = 1
STATE_TPDOS = (1, 2)


def drive_contract(node_id: int, follows: Follows, axes: Sequence[int] = ()) -> Iterator[Wanted]:
    """Yield the objects of a drive in the order of reading. axes: of a node with several, those in use.

    Transmission types are not compared: drives of other makes send TPDO 2 in their own time. Identity and
    scale are read by identify.py.
    """
    if axes:
        yield from _axes_contract(node_id, follows, axes)
        return
    od = load_eds(CIA402_EDS, node_id)
    remedy = f"palpate-host bus sdo restore 0x{node_id:02X}, or map it as in {od.source}"
    yield from pdos_of(od, PdoDirection.TRANSMIT, STATE_TPDOS, STATE_TPDOS, remedy, types=False)
    yield from pdos_of(od, PdoDirection.RECEIVE, (), (COMMAND_RPDO,), remedy)
    yield from mapping_of(PdoDirection.RECEIVE, COMMAND_RPDO, COMMAND_MAPPING[follows], remedy)


def _axes_contract(node_id: int, follows: Follows, axes: Sequence[int]) -> Iterator[Wanted]:
    """Yield COB-IDs and mappings, and the mode of each axis: the host has written both."""
    od = axes_dictionary(node_id)
    remedy = f"restart the drive's node; if it differs again, compare the node with {od.source}"
    states = {number: state_words(part) for number, part in enumerate(axes_of_tpdos(axes), 1)}
    command = {COMMAND_RPDO: command_words(axes, COMMAND_MAPPING[follows][-1])}
    for direction, used in ((PdoDirection.TRANSMIT, states), (PdoDirection.RECEIVE, command)):
        yield from pdos_of(od, direction, (), used, remedy)
        for number, words in used.items():
            yield from mapping_of(direction, number, words, remedy)
    best, other = MODES_BEST_FIRST[follows]
    for axis in axes:
        yield Wanted(axis_key(MODE_DISPLAY, axis), best, remedy, also=other)
