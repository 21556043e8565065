"""The meaning of the objects of ``fingertip.eds``: raw values of a contact and of the board's health.

A doubtful value is never sent as valid. A rejected frame, or a required value that is missing, not finite or
beyond its data type, clears the valid and the contact flag. The status of each channel (6150h) has the cause.
What a sensor never gives (SensorOutputs) is 8000h, with a flag of its own in place of the valid flag.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum, IntFlag

import msgspec

from palpate_edge.can_bus.clock_sync import ClockState
from palpate_edge.common.contact import Contact
from palpate_edge.common.contact_quantities import (
    AI_INPUT,
    AI_STATUS,
    NOT_GIVEN,
    POSE_TPDOS,
    QUANTITIES,
    Quantity,
    SensorOutputs,
    values_of,
)
from palpate_edge.node.object_dictionary import ObjectKey

METHOD, CALIBRATION_HASH, MODEL_HASH, LOCATION, NEVER_GIVEN = 0x2000, 0x2001, 0x2002, 0x2003, 0x2004
DATA_BITRATE = 0x2005
FLAGS, QUALITY, EXPOSURE_TIME, SEQUENCE, LATENCY = 0x2010, 0x2011, 0x2012, 0x2013, 0x2014
TEMPERATURE, BEADS_LOST, FRAMES_DROPPED, LED_LEVEL = 0x2020, 0x2021, 0x2022, 0x2023
SKIN_DRIFT = 0x2024
LED_SET_POINT, CAMERA_EXPOSURE = 0x2030, 0x2031
LATENCY_HISTOGRAM, COUNTERS, BUS_CLOCK = 0x2040, 0x2041, 0x2042

INT16_MIN, INT16_MAX, UINT16_MAX, UINT8_MAX = -0x8000, 0x7FFF, 0xFFFF, 0xFF
INT32_MIN, INT32_MAX, UINT32_MAX = -0x8000_0000, 0x7FFF_FFFF, 0xFFFF_FFFF
TEMPERATURE_UNKNOWN = INT16_MAX
LOWEST = NOT_GIVEN + 1  # raw value of a measured quantity


class MethodCode(IntEnum):
    """Object 2000h."""

    PAPER = 0
    CORRECTED = 1
    POSE = 2


class Counter(IntEnum):
    """Sub-indices of 2041h."""

    FRAMES_ESTIMATED = 1
    FRAMES_REFUSED = 2
    FRAMES_DROPPED = 3
    WHOLE_IMAGE_SEARCHES = 4
    TRANSMIT_RETRIES = 5
    BUS_RESTARTS = 6
    PDOS_DROPPED = 7
    RECEIVE_OVERRUNS = 8
    BUS_ERROR_FRAMES = 9
    FOREIGN_FRAMES = 10
    FRAMES_DAMAGED = 11
    BEADS_NOT_FOUND = 12
    BUS_CLOCK_STEPS = 13
    TIME_STAMPS_REJECTED = 14
    FRAMES_NOT_RECORDED = 15
    LIGHT_CONTROLLER_LOSSES = 16
    LIGHT_CONTROLLER_PEC_ERRORS = 17
    CAMERA_TRIGGERS = 18
    ID_CONFLICTS = 19


CLOCK_STATES = {ClockState.FREE: 0, ClockState.SYNCHRONISED: 1, ClockState.LOST: 2}
"""Values of 2042h:01."""


class ContactFlag(IntFlag):
    """Object 2010h. SLIP and SLIP_BEGINS only together with CONTACT and VALID.

    VALID: everything is, place and force included. NO_PLACE, NO_FORCE: the frame is valid, but its sensor
    never gives that; VALID is then clear, so that a master that does not know these flags uses nothing.
    """

    CONTACT = 0x01
    SLIP = 0x02
    VALID = 0x04
    NO_PLACE = 0x08
    NO_FORCE = 0x10
    SLIP_BEGINS = 0x20


VALID_FLAGS = ContactFlag.VALID | ContactFlag.NO_PLACE | ContactFlag.NO_FORCE
"""One of these flags is set unless the frame was rejected."""


class ChannelStatus(IntEnum):
    """Object 6150h (CiA 404, AI status); 0 is good. An overload is not valid either."""

    GOOD = 0x00
    NOT_VALID = 0x01
    POSITIVE_OVERLOAD = 0x03
    NEGATIVE_OVERLOAD = 0x05


LATENCY_BINS_US = (2_000, 5_000, 10_000, 15_000, 20_000, 30_000, 50_000)
"""Upper edges of the sub-indices of 2040h; the last sub-index is beyond them."""

CONTACT, SLIP, VALID = int(ContactFlag.CONTACT), int(ContactFlag.SLIP), int(ContactFlag.VALID)
SLIP_BEGINS = int(ContactFlag.SLIP_BEGINS)
NO_PLACE, NO_FORCE = int(ContactFlag.NO_PLACE), int(ContactFlag.NO_FORCE)

NOTHING_KNOWN: tuple[float | None, ...] = (None,) * len(QUANTITIES)

ROWS = tuple(enumerate(QUANTITIES))
WITHOUT_POSE = tuple((place, row) for place, row in ROWS if row.tpdo[0] not in POSE_TPDOS)
"""Rows with their places. Without poses, their objects keep the defaults of the EDS, "not given"."""

DOME_OUTPUTS = SensorOutputs()


class Health(msgspec.Struct, frozen=True):
    """The board's state for TPDO 4, 2024h, 2031h and 2041h.

    frames_dropped: since the start. led_level: 0 (off) to 255. skin_drift_px: of the untouched skin since the
    reference frames or the last tare. exposure_us: 0 when unknown. counters: for 2041h, since the start,
    without those of frames.
    """

    temperature_degC: float | None
    frames_dropped: int
    led_level: int
    skin_drift_px: float = 0.0
    exposure_us: int = 0
    counters: Mapping[Counter, int] = msgspec.field(default_factory=dict)


def encode_contact(
    contact: Contact, latency_us: int, outputs: SensorOutputs = DOME_OUTPUTS
) -> dict[ObjectKey, int]:
    """Return the raw values of the TPDOs of a contact, of 6150h and 2021h.

    contact.exposed_at_us becomes 2012h as it is; `FingertipNode.publish` replaces it when it is not on the
    bus clock.
    latency_us: from exposure until now. outputs: what the sensor gives.
    """
    objects: dict[ObjectKey, int] = {}
    doubt = not contact.valid or not math.isfinite(contact.quality)
    never = never_given(outputs)
    values = channel_values(contact, outputs)
    for place, quantity in ROWS if outputs.pose else WITHOUT_POSE:
        value = values[place]
        if quantity.attribute in never:
            raw, status = NOT_GIVEN, ChannelStatus.NOT_VALID
        else:
            raw, status = encode_channel(value, quantity)
            if status and not (quantity.optional and value is None):
                doubt = True
        objects[AI_INPUT, quantity.channel] = raw
        objects[AI_STATUS, quantity.channel] = int(status)  # a plain int is found in its range at once
    flags = 0 if doubt else never_given_flags(outputs) or VALID
    if flags and contact.in_contact:
        if flags == VALID:
            flags |= (SLIP if contact.slip else 0) | (SLIP_BEGINS if contact.slip_begins else 0)
        flags |= CONTACT
    objects[FLAGS, 0] = flags
    objects[QUALITY, 0] = 0 if doubt else clamp(UINT8_MAX * contact.quality, 0, UINT8_MAX)
    objects[EXPOSURE_TIME, 0] = contact.exposed_at_us & UINT32_MAX
    objects[SEQUENCE, 0] = contact.sequence & UINT16_MAX
    objects[LATENCY, 0] = clamp(latency_us, 0, UINT16_MAX)
    objects[BEADS_LOST, 0] = clamp(contact.beads_expected - contact.beads_found, 0, UINT16_MAX)
    return objects


def encode_health(health: Health) -> dict[ObjectKey, int]:
    """Return the objects of TPDO 4 (but 2021h, which belongs to the contact), 2024h, 2031h and the
    counters."""
    temperature = TEMPERATURE_UNKNOWN
    if health.temperature_degC is not None and math.isfinite(health.temperature_degC):
        temperature = clamp(10 * health.temperature_degC, INT16_MIN, TEMPERATURE_UNKNOWN - 1)
    return {
        (TEMPERATURE, 0): temperature,
        (FRAMES_DROPPED, 0): clamp(health.frames_dropped, 0, UINT16_MAX),
        (LED_LEVEL, 0): clamp(health.led_level, 0, UINT8_MAX),
        (CAMERA_EXPOSURE, 0): clamp(health.exposure_us, 0, UINT32_MAX),
        (SKIN_DRIFT, 0): clamp(100 * health.skin_drift_px, 0, UINT16_MAX),
        (COUNTERS, Counter.FRAMES_DROPPED): health.frames_dropped & UINT32_MAX,
    } | {(COUNTERS, int(counter)): count & UINT32_MAX for counter, count in health.counters.items()}


def encode_bus_clock(state: ClockState, drift_ppb: float, standard_error_us: float) -> dict[ObjectKey, int]:
    """The objects of 2042h; drift against the board's own clock in 1e-9."""
    return {
        (BUS_CLOCK, 1): CLOCK_STATES[state],
        (BUS_CLOCK, 2): clamp(drift_ppb, INT32_MIN, INT32_MAX),
        (BUS_CLOCK, 3): clamp(standard_error_us, 0, UINT32_MAX),
    }


def never_given(outputs: SensorOutputs) -> tuple[str, ...]:
    """Return the attributes that a sensor never gives, of those that others always give."""
    return (() if outputs.place else ("position_mm",)) + (
        () if outputs.force else ("normal_force_N", "shear_N")
    )


def never_given_flags(outputs: SensorOutputs) -> int:
    """Return the flags of what a sensor never gives, as in 2004h and 2010h; 0 if place and force."""
    return (0 if outputs.place else NO_PLACE) | (0 if outputs.force else NO_FORCE)


def channel_values(contact: Contact, outputs: SensorOutputs = DOME_OUTPUTS) -> tuple[float | None, ...]:
    """Return the quantities in the order of QUANTITIES, each in its unit; None where nothing is known.

    While nothing touches the dome, each is 0, except those that have a raw value for "not given".
    """
    if not contact.valid:
        return NOTHING_KNOWN
    if not contact.in_contact:
        return tuple(0.0 if row.not_given is None else row.of(contact) for row in QUANTITIES)
    if contact.position_mm is None and outputs.place:
        return NOTHING_KNOWN
    return values_of(contact)


def encode_channel(value: float | None, quantity: Quantity) -> tuple[int, ChannelStatus]:
    """Return one channel as INTEGER16, held at the end of the range where the value goes beyond it.

    A missing value, or one that is not finite, gives the quantity's raw value for "not given", which no
    measured value has.
    """
    if value is None or not math.isfinite(value):
        return quantity.not_given or 0, ChannelStatus.NOT_VALID
    increments = value * quantity.increments_per_unit
    if increments >= INT16_MAX + 0.5:
        return INT16_MAX, ChannelStatus.POSITIVE_OVERLOAD
    if increments < LOWEST - 0.5:
        return LOWEST, ChannelStatus.NEGATIVE_OVERLOAD
    return round(increments), ChannelStatus.GOOD


def clamp(value: float, low: int, high: int) -> int:
    """The whole number nearest to `value`, which may be infinite, within `low` and `high`."""
    return round(max(low, min(high, value)))
