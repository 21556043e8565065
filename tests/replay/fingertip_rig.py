"""The fingertip's side of a log: recorded frames and the bus in, finger-2's frames out; no clock, no sleep.

contacts.json is what the estimator (the paper's method, calibrated on demo/recording/press) sees in the first
frames of demo/recording/finger-2; the node then publishes them while a log of the bus goes by.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.reconnecting_bus import BusState, BusStateChange
from palpate_edge.common.contact import Contact
from palpate_edge.daemon.fingertip_core import FingertipCore
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import Health, MethodCode

HERE = Path(__file__).parent
RECORDING = HERE.parents[1] / "demo" / "recording"
CONTACTS = HERE / "contacts.json"
NODE = 0x11
FRAMES = 150
FRAME_US = 33_333
LATENCY_US = 4_000  # exposure to contact
CAMERA_TIMEOUT_US = 200_000  # capture.timeout_ms of a fingertip's configuration
HEALTH = Health(temperature_degC=31.5, frames_dropped=0, led_level=128)
SENT_BY_NODE = (0x080, 0x180, 0x280, 0x300, 0x380, 0x480, 0x580, 0x700)

# What happens beside the bus, after the log's first frame: a camera that stops, a controller that comes back.
CAMERA_STOPS_US = {"fingertip-lost": 1_500_000}
BUS_OFF_US = {"bus-off": (1_500_000, 2_100_000)}


def estimate_frames() -> list[Contact]:
    """Contacts of the recorded frames, as `palpate-edge run` would estimate them."""
    from palpate_edge.calibration.calibrate import calibrate
    from palpate_edge.datasets.press_dataset import read_dataset
    from palpate_edge.datasets.recording import all_frames, open_recording
    from palpate_edge.estimation.estimator import Estimator
    from palpate_edge.estimation.frame_estimator import Method as Estimation

    calibration = calibrate(read_dataset(RECORDING / "press"))
    recording = open_recording(RECORDING / "finger-2", grey=calibration.appearance.channel == "grey")
    estimator = Estimator(calibration, Estimation.PAPER)
    contacts = []
    try:
        for frame in all_frames(recording):
            contacts.append(estimator.estimate(frame))
            if len(contacts) == FRAMES:
                return contacts
    finally:
        recording.close()
    return contacts


def write_contacts() -> None:
    CONTACTS.write_bytes(msgspec.json.encode(estimate_frames()) + b"\n")


def read_contacts() -> list[Contact]:
    return msgspec.json.decode(CONTACTS.read_bytes(), type=list[Contact])


def fingertip_frames(name: str, records: tuple[LogRecord, ...]) -> list[LogRecord]:
    """What finger-2's node sends while the log goes by.

    Its own frames in the log are the recorded ones and not
    heard again, except those of a clash, which are not its own.
    """
    begin_us = records[0].stamp_us
    stops_us = begin_us + CAMERA_STOPS_US.get(name, 1 << 40)
    off_us, on_us = (begin_us + at for at in BUS_OFF_US.get(name, (1 << 40, 1 << 40)))
    core = FingertipCore(FingertipNode(NODE, MethodCode.PAPER, "0" * 16), CAMERA_TIMEOUT_US, begin_us)
    events: list[tuple[int, int, object]] = [
        (record.stamp_us, 0, record.frame)
        for record in records
        if record.frame.can_id - NODE not in SENT_BY_NODE and not off_us <= record.stamp_us < on_us
    ]
    if name == "node-id-clash":
        boots = [r for r in records if r.frame.can_id == 0x700 + NODE and r.frame.data == b"\x00"]
        events.append((boots[-1].stamp_us, 0, boots[-1].frame))
    for number, contact in enumerate(read_contacts()):
        exposed_us = begin_us + FRAME_US * number
        if exposed_us < stops_us:
            seen = replace(contact, sequence=number, exposed_at_us=exposed_us)
            events.append((exposed_us + LATENCY_US, 1, seen))
    if on_us < records[-1].stamp_us:
        events.append((on_us, 2, BusStateChange(BusState.UP, "", after_bus_off=True)))
    events.sort(key=lambda event: event[:2])
    return _run(core, events, begin_us, records[-1].stamp_us, range(off_us, on_us))


def _run(core, events, now_us: int, end_us: int, off: range) -> list[LogRecord]:
    sent: list[LogRecord] = []
    taken = 0
    while True:
        while taken < len(events) and events[taken][0] <= now_us:
            at_us, _, what = events[taken]
            taken += 1
            if isinstance(what, CanFrame):
                core.receive(now_us, [(at_us, what)])
            elif isinstance(what, Contact):
                frames = core.contact(now_us, what)
                core.frame_seen(now_us, what, HEALTH)
                if now_us not in off:
                    sent += [LogRecord(now_us, frame) for frame in frames]
            else:
                core.bus_state_changed(what)
        step = core.poll(now_us)
        if now_us not in off:
            sent += [LogRecord(now_us, frame) for frame in step.frames_out]
        due_us = min(step.next_due_us, events[taken][0] if taken < len(events) else end_us + 1)
        if due_us > end_us:
            return sent
        now_us = max(due_us, now_us + 1)
