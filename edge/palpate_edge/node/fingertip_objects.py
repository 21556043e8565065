"""What the objects of ``fingertip.eds`` mean: from a contact and the board's health to their raw values.

What is doubtful is never sent as valid: a refused frame, or a value that is missing, not finite or beyond its
data type, clears the valid and the contact flag; the status (6150h) of each channel says which it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from palpate_edge.common.contact import Contact, Vector3
from palpate_edge.node.object_dictionary import ObjectKey

AI_AUTOZERO, AI_STATUS, AI_INPUT = 0x6125, 0x6150, 0x7130
METHOD, CALIBRATION_HASH, MODEL_HASH, LOCATION = 0x2000, 0x2001, 0x2002, 0x2003
FLAGS, QUALITY, EXPOSURE_TIME, SEQUENCE, LATENCY = 0x2010, 0x2011, 0x2012, 0x2013, 0x2014
TEMPERATURE, BEADS_LOST, FRAMES_DROPPED, LED_LEVEL = 0x2020, 0x2021, 0x2022, 0x2023
SKIN_DRIFT = 0x2024
LED_SET_POINT, CAMERA_EXPOSURE = 0x2030, 0x2031
LATENCY_HISTOGRAM, COUNTERS, BUS_CLOCK = 0x2040, 0x2041, 0x2042

INT16_MIN, INT16_MAX, UINT16_MAX, UINT8_MAX = -0x8000, 0x7FFF, 0xFFFF, 0xFF
INT32_MIN, INT32_MAX, UINT32_MAX = -0x8000_0000, 0x7FFF_FFFF, 0xFFFF_FFFF
TEMPERATURE_UNKNOWN = INT16_MAX
TORSION_NOT_GIVEN = INT16_MIN


class MethodCode(IntEnum):
    """Object 2000h."""

    PAPER = 0
    CORRECTED = 1


class Counter(IntEnum):
    """Sub-indices of 2041h."""

    FRAMES_ESTIMATED = 1
    FRAMES_REFUSED = 2
    FRAMES_DROPPED = 3
    WHOLE_IMAGE_SEARCHES = 4
    TRANSMIT_RETRIES = 5
    BUS_RESTARTS = 6


class BusClockState(IntEnum):
    """Object 2042h:01."""

    NONE = 0
    LOCKED = 1
    FREE_RUNNING = 2


class ContactFlag(IntFlag):
    """Object 2010h. SLIP only together with CONTACT and VALID."""

    CONTACT = 0x01
    SLIP = 0x02
    VALID = 0x04


class ChannelStatus(IntEnum):
    """Object 6150h (CiA 404, AI status); 0 is good. An overload is not valid either."""

    GOOD = 0x00
    NOT_VALID = 0x01
    POSITIVE_OVERLOAD = 0x03
    NEGATIVE_OVERLOAD = 0x05


class Channel(IntEnum):
    """Sub-indices of 7130h, 6131h, 6132h, 6150h."""

    X = 1
    Y = 2
    Z = 3
    NORMAL_FORCE = 4
    SHEAR_X = 5
    SHEAR_Y = 6
    TORSION = 7


INCREMENTS_PER_UNIT = {
    Channel.X: 100,
    Channel.Y: 100,
    Channel.Z: 100,
    Channel.NORMAL_FORCE: 1000,
    Channel.SHEAR_X: 1000,
    Channel.SHEAR_Y: 1000,
    Channel.TORSION: 100,
}
"""Ten to the power of 6132h, for mm, N and N mm."""

OPTIONAL_CHANNELS = frozenset({Channel.SHEAR_X, Channel.SHEAR_Y, Channel.TORSION})
"""A method may give none of these without the contact being in doubt."""

LATENCY_BINS_US = (2_000, 5_000, 10_000, 15_000, 20_000, 30_000, 50_000)
"""Upper edges of the sub-indices of 2040h; the last sub-index is beyond them."""

FREE, TOUCHING = int(ContactFlag.VALID), int(ContactFlag.VALID | ContactFlag.CONTACT)
SLIPPING = int(ContactFlag.VALID | ContactFlag.CONTACT | ContactFlag.SLIP)
"""2010h of a frame that is in no doubt."""

NOTHING_KNOWN: tuple[float | None, ...] = (None,) * len(Channel)
NOTHING_TOUCHED = (0.0,) * (len(Channel) - 1)
"""All channels, and all but the torsion."""

CHANNEL_OBJECTS = tuple(
    (
        (AI_INPUT, int(channel)),
        (AI_STATUS, int(channel)),
        INCREMENTS_PER_UNIT[channel],
        channel in OPTIONAL_CHANNELS,
    )
    for channel in Channel
)
"""Of each channel: keys of its value and its status, increments in a unit, whether it may be missing."""

TORSION_KEY = (AI_INPUT, int(Channel.TORSION))


@dataclass(frozen=True, slots=True)
class Health:
    """The board's state for TPDO 4, 2024h, 2031h and 2041h; counters since the start.

    led_level: 0 (off) to 255; skin_drift_px: how far the untouched skin has gone since the reference frames
    or the last tare; exposure_us: 0 when the camera tells none.
    """

    temperature_degC: float | None
    frames_dropped: int
    led_level: int
    skin_drift_px: float = 0.0
    whole_image_searches: int = 0
    transmit_retries: int = 0
    bus_restarts: int = 0
    exposure_us: int = 0


def encode_contact(contact: Contact, latency_us: int) -> dict[ObjectKey, int]:
    """The objects of TPDO 1 to 3, 6150h and 2021h.

    contact.exposed_at_us: on the bus's clock. latency_us: from exposure until now.
    """
    objects: dict[ObjectKey, int] = {}
    doubt = not contact.valid or not math.isfinite(contact.quality)
    for value, (input_key, status_key, increments_per_unit, optional) in zip(
        channel_values(contact), CHANNEL_OBJECTS, strict=True
    ):
        objects[input_key], status = encode_channel(value, increments_per_unit)
        objects[status_key] = int(status)  # a plain one is found in its range at once
        if status and not (optional and value is None):
            doubt = True
    if contact.torsion_Nmm is None:
        objects[TORSION_KEY] = TORSION_NOT_GIVEN  # a zero would pass for a measured one
    touching = SLIPPING if contact.slip else TOUCHING
    objects[FLAGS, 0] = 0 if doubt else touching if contact.in_contact else FREE
    objects[QUALITY, 0] = 0 if doubt else clamp(UINT8_MAX * contact.quality, 0, UINT8_MAX)
    objects[EXPOSURE_TIME, 0] = contact.exposed_at_us & UINT32_MAX
    objects[SEQUENCE, 0] = contact.sequence & UINT16_MAX
    objects[LATENCY, 0] = clamp(latency_us, 0, UINT16_MAX)
    objects[BEADS_LOST, 0] = clamp(contact.beads_expected - contact.beads_found, 0, UINT16_MAX)
    return objects


def encode_health(health: Health) -> dict[ObjectKey, int]:
    """The objects of TPDO 4 (but 2021h, which goes with the contact), 2024h, 2031h, the health's in 2041h."""
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
        (COUNTERS, Counter.WHOLE_IMAGE_SEARCHES): health.whole_image_searches & UINT32_MAX,
        (COUNTERS, Counter.TRANSMIT_RETRIES): health.transmit_retries & UINT32_MAX,
        (COUNTERS, Counter.BUS_RESTARTS): health.bus_restarts & UINT32_MAX,
    }


def encode_bus_clock(
    state: BusClockState, drift_ppb: float, standard_error_us: float
) -> dict[ObjectKey, int]:
    """The objects of 2042h; drift against the board's own clock in 1e-9."""
    return {
        (BUS_CLOCK, 1): state,
        (BUS_CLOCK, 2): clamp(drift_ppb, INT32_MIN, INT32_MAX),
        (BUS_CLOCK, 3): clamp(standard_error_us, 0, UINT32_MAX),
    }


def channel_values(contact: Contact) -> tuple[float | None, ...]:
    """The channels in the order of `Channel`, in mm, N or N mm; None where nothing is known."""
    if not contact.valid:
        return NOTHING_KNOWN
    if not contact.in_contact:
        return (*NOTHING_TOUCHED, contact.torsion_Nmm)
    position_mm, force_N = contact.position_mm, contact.force_N
    if position_mm is None:
        return NOTHING_KNOWN
    x_N, y_N = (None, None) if force_N is None else tangential_force_N(position_mm, force_N)[:2]
    return (*position_mm, contact.normal_force_N, x_N, y_N, contact.torsion_Nmm)


def tangential_force_N(position_mm: Vector3, force_N: Vector3) -> Vector3:
    """The part of `force_N` across the sphere's normal at `position_mm`; NaN at the sphere's centre."""
    distance_mm = math.hypot(*position_mm)
    if distance_mm == 0.0:
        return math.nan, math.nan, math.nan
    (x, y, z), (x_N, y_N, z_N) = position_mm, force_N
    along_N_mm = (x_N * x + y_N * y + z_N * z) / distance_mm / distance_mm
    return x_N - along_N_mm * x, y_N - along_N_mm * y, z_N - along_N_mm * z


def encode_channel(value: float | None, increments_per_unit: int) -> tuple[int, ChannelStatus]:
    """One channel as INT16, held at its end where the value goes beyond it."""
    if value is None or not math.isfinite(value):
        return 0, ChannelStatus.NOT_VALID
    increments = value * increments_per_unit
    if increments >= INT16_MAX + 0.5:
        return INT16_MAX, ChannelStatus.POSITIVE_OVERLOAD
    if increments < INT16_MIN - 0.5:
        return INT16_MIN, ChannelStatus.NEGATIVE_OVERLOAD
    return round(increments), ChannelStatus.GOOD


def clamp(value: float, low: int, high: int) -> int:
    """The whole number nearest to `value`, which may be infinite, within `low` and `high`."""
    return round(max(low, min(high, value)))
