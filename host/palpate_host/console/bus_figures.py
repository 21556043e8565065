"""Figures of the hand's bus from the frames on it: load, and what fingertips publish of themselves. Pure."""

from __future__ import annotations

import msgspec

from palpate_bus.load.bit_count import frame_bits
from palpate_bus.load.measured_load import WINDOW_US, BusLoad
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip_objects import LED_LEVEL, TEMPERATURE, TEMPERATURE_UNKNOWN
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoDirection, pdo_codec
from palpate_host.config.hand_config import HandConfig

HEALTH_TPDO = 4
OLD_US = 3_000_000
"""A fingertip publishes its health three times a second; older values are not shown."""


class FingertipLight(msgspec.Struct, frozen=True):
    """silicone_degC: None when the fingertip does not measure it. led_level: 0 (off) to 255."""

    silicone_degC: float | None
    led_level: int


class BusNews(msgspec.Struct, frozen=True):
    """load: share of the bit rate in the last second; frames_s: frames in it; both None until a second was
    measured. fingertips: in the order of hand.toml, None without a recent TPDO 4. failure: why the bus cannot
    be read, or empty."""

    load: float | None
    frames_s: int | None
    fingertips: list[FingertipLight | None]
    failure: str = ""


class BusFigures:
    """Takes all frames of a bus from `begun_us` on; times are those of the frames' stamps."""

    def __init__(self, config: HandConfig, begun_us: int) -> None:
        self._bitrate, self._begun_us = config.bus.bitrate, begun_us
        self._load, self._frames, self._frames_before = BusLoad(), 0, 0
        self._lights: list[tuple[int, FingertipLight] | None] = [None] * len(config.fingers)
        ods = [load_eds(FINGERTIP_EDS, finger.fingertip_node) for finger in config.fingers]
        codecs = [pdo_codec(od, PdoDirection.TRANSMIT, HEALTH_TPDO) for od in ods]
        self._codecs = {codec.cob_id: (place, codec) for place, codec in enumerate(codecs)}

    def take(self, stamp_us: int, frame: CanFrame) -> None:
        """Count a frame. A TPDO 4 of another length than in the EDS is counted and not decoded."""
        self._load.count(stamp_us, frame.can_id, frame_bits(frame))
        if frame.can_id in self._codecs:
            place, codec = self._codecs[frame.can_id]
            if len(frame.data) == codec.length_bytes:
                values = codec.decode(frame.data)
                raw = values[TEMPERATURE, 0]
                degC = None if raw == TEMPERATURE_UNKNOWN else raw / 10
                self._lights[place] = (stamp_us, FingertipLight(degC, values[LED_LEVEL, 0]))

    def news(self, now_us: int) -> BusNews:
        """Return the figures at `now_us`; call it once a second."""
        frames = self._load.frames - self._frames_before
        self._frames_before = self._load.frames
        lights = [light[1] if light and now_us - light[0] < OLD_US else None for light in self._lights]
        if now_us - self._begun_us < WINDOW_US:
            return BusNews(None, None, lights)
        return BusNews(self._load.window_bits(now_us) / self._bitrate, frames, lights)
