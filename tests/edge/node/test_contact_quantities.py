"""The table of contact quantities against fingertip.eds, and its codec on the bus in both directions."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.eds.text import Findings, parse_sections
from palpate_edge.common import contact_quantities as table
from palpate_edge.common.contact import Contact, LabelEstimate, Vector3
from palpate_edge.common.contact_quantities import (
    CONTACT_TPDOS,
    FD_TPDO,
    FD_TPDO_POSES,
    POSE_LABELS,
    QUANTITIES,
    OptionalQuantities,
    Quantity,
    SensorOutputs,
)
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip_objects import ContactFlag, encode_contact
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoDirection, pdo_codec
from palpate_edge.node.pdo_parameters import pdo_numbers

OD = load_eds(FINGERTIP_EDS, 0x10)
ROWS = pytest.mark.parametrize("quantity", QUANTITIES, ids=lambda quantity: quantity.name)

# Sections of one channel in the EDS: object, words before the name, and what the section has to hold.
UNSIGNED8, INTEGER16, UNSIGNED32 = "0x0005", "0x0003", "0x0007"


def sections_of(quantity: Quantity) -> dict[str, dict[str, str]]:
    """Return the sections that the EDS needs for a quantity, ready to be pasted."""
    not_given = 0 if quantity.not_given is None else quantity.not_given
    contents = (
        (table.AI_AUTOZERO, "Autozero", UNSIGNED32, "wo", "", "0"),
        (table.AI_UNIT, "Unit of", UNSIGNED32, "ro", f"0x{table.UNIT_CODES[quantity.unit]:08X}", "0"),
        (table.AI_DECIMALS, "Decimal digits of", UNSIGNED8, "ro", str(quantity.decimals), "0"),
        (table.AI_STATUS, "Status of", UNSIGNED8, "ro", "1", "1"),
        (table.AI_INPUT, "Value of", INTEGER16, "ro", str(not_given), "1"),
    )
    return {
        f"{index:04x}sub{quantity.channel:x}": {
            "ParameterName": f"{words} {quantity.name}",
            "ObjectType": "0x7",
            "DataType": data_type,
            "AccessType": access,
            "DefaultValue": default,
            "PDOMapping": mappable,
        }
        for index, words, data_type, access, default, mappable in contents
    }


@ROWS
def test_the_eds_describes_the_quantity(quantity: Quantity) -> None:
    """A failure shows the section as it has to be in firmware/fingertip.eds."""
    sections = parse_sections(FINGERTIP_EDS.read_text(), Findings())
    for name, expected in sections_of(quantity).items():
        wanted = "\n".join([f"[{name}]", *(f"{key}={value}" for key, value in expected.items())])
        assert name in sections, f"add to firmware/fingertip.eds:\n{wanted}"
        found = {key: sections[name].value(key) for key in expected}
        assert found == expected, f"firmware/fingertip.eds needs:\n{wanted}"


def test_the_eds_has_no_channel_beyond_the_table() -> None:
    for index in (table.AI_AUTOZERO, table.AI_UNIT, table.AI_DECIMALS, table.AI_STATUS, table.AI_INPUT):
        channels = {subindex for entry, subindex in OD.entries if entry == index and subindex}
        assert channels == {quantity.channel for quantity in QUANTITIES}


def test_the_mappings_of_the_eds_are_the_tables() -> None:
    mapped = {
        (number, place): entry.subindex
        for number in pdo_numbers(OD, PdoDirection.TRANSMIT)
        if number != FD_TPDO
        for place, entry in enumerate(pdo_codec(OD, PdoDirection.TRANSMIT, number).layout.entries, start=1)
        if entry.index == table.AI_INPUT
    }
    assert mapped == {quantity.tpdo: quantity.channel for quantity in QUANTITIES}


def test_the_fd_tpdo_maps_every_quantity_once_and_poses_last() -> None:
    words = [OD.default_number(0x1A09, slot) for slot in range(1, 1 + FD_TPDO_POSES)]
    assert (0x1A09, 1 + FD_TPDO_POSES) not in OD.entries
    places = {word >> 8 & 0xFF: place for place, word in enumerate(words) if word >> 16 == table.AI_INPUT}
    assert places.keys() == {quantity.channel for quantity in QUANTITIES}
    without = OD.default_number(0x1A09, 0)
    poses = {quantity.channel for quantity in QUANTITIES if quantity.attribute == "flat_pose"}
    assert {channel for channel, place in places.items() if place >= without} == poses
    classic = [
        pdo_codec(OD, PdoDirection.TRANSMIT, number).layout.keys
        for number in pdo_numbers(OD, PdoDirection.TRANSMIT)
        if number in CONTACT_TPDOS
    ]
    assert {(word >> 16, word >> 8 & 0xFF) for word in words} == {key for keys in classic for key in keys}


def test_every_row_is_a_quantity_of_its_own() -> None:
    for names in ("name", "column", "channel", "tpdo"):
        values = [getattr(quantity, names) for quantity in QUANTITIES]
        assert len(set(values)) == len(values), names
    assert {field.name for field in fields(OptionalQuantities)} == {
        quantity.attribute for quantity in QUANTITIES if quantity.optional and quantity.element is None
    }


ANY_FLOAT = st.none() | st.floats()
VECTORS = st.none() | st.tuples(st.floats(), st.floats(), st.floats())
POSES = st.lists(st.sampled_from(POSE_LABELS), unique=True).flatmap(
    lambda labels: st.tuples(
        *(st.builds(LabelEstimate, st.just(one), st.floats(), st.floats()) for one in labels)
    )
)
OUTPUTS = st.builds(SensorOutputs, st.booleans(), st.booleans(), st.booleans())
OPTIONAL = {field.name: ANY_FLOAT for field in fields(OptionalQuantities)}


@dataclass(frozen=True)
class Measured:
    """Contact with any value for any quantity, as the codec reads it."""

    values: dict[str, float | Vector3 | tuple[LabelEstimate, ...] | None]

    def contact(self) -> Contact:
        return Contact(
            sequence=1,
            exposed_at_us=2,
            valid=True,
            in_contact=True,
            quality=1.0,
            reason="",
            beads_found=85,
            beads_expected=85,
            **self.values,  # type: ignore[arg-type]
        )


CONTACTS = st.builds(
    Measured,
    st.fixed_dictionaries(
        {"position_mm": VECTORS, "normal_force_N": ANY_FLOAT, "force_N": VECTORS, "pose": POSES, **OPTIONAL}
    ),
)


@given(CONTACTS, OUTPUTS)
def test_what_was_encoded_is_decoded(measured: Measured, outputs: SensorOutputs) -> None:
    """To half an increment; out of range at the range's end; None or not finite never as a valid number.

    What the sensor never gives is None, whatever the contact says, and VALID is clear.
    """
    contact = measured.contact()
    objects = encode_contact(contact, 0, outputs)
    raws = {channel: raw for (index, channel), raw in objects.items() if index == table.AI_INPUT}
    decoded = table.fields_of(raws)
    known = contact.position_mm is not None or not outputs.place
    values = table.values_of(contact) if known else (None,) * len(QUANTITIES)
    never = {"position_mm": outputs.place, "normal_force_N": outputs.force, "shear_N": outputs.force}
    flags = objects[0x2010, 0]
    for quantity, value in zip(QUANTITIES, values, strict=True):
        if quantity.channel not in raws:
            assert quantity.attribute == "flat_pose" and not outputs.pose
            continue
        back = quantity.value(raws[quantity.channel])
        status = objects[table.AI_STATUS, quantity.channel]
        low, high = -0x7FFF / quantity.increments_per_unit, 0x7FFF / quantity.increments_per_unit
        if not never.get(quantity.attribute, True):
            assert (status, back, flags & ContactFlag.VALID) == (1, None, 0)
        elif value is None or not math.isfinite(value):
            assert status == 1
            assert back == (0.0 if quantity.not_given is None else None)
            if value is not None or not quantity.optional:
                assert flags == 0
        elif low <= value <= high:
            assert status == 0
            assert abs(back - value) <= 0.5001 / quantity.increments_per_unit
        else:
            assert back == (low if value < low else high)
            assert flags == 0
    if outputs.place and outputs.force:
        assert flags in (0, ContactFlag.VALID | ContactFlag.CONTACT)
    if flags & ContactFlag.VALID:
        assert None not in values[:4]
    assert (decoded["position_mm"] is None) == (not outputs.place)
    assert (decoded["normal_force_N"] is None) == (not outputs.force)
