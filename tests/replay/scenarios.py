"""What goes wrong on a bus, done to a normal log by seeded functions.

``normal`` is a run of the host, nine drives and three fingertips in virtual time. Each scenario changes what
the nodes' side of the bus says from FAULT_US on (or the whole time); the host's own frames stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from random import Random

import msgspec

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.config.hand_config import HandConfig

START_US = 1_700_000_000_000_000
FAULT_US = START_US + 1_500_000
SECONDS = 4.8  # a lost fingertip stops the hand 3 s after its last frame

FINGER_2, FINGER_3 = 0x11, 0x12
TIPS = (0x10, FINGER_2, FINGER_3)
CONTACT_TPDOS = (0x180, 0x280, 0x300, 0x380)  # TPDO 1, 2, 5 and 3: the order of the bus
SENT_BY_NODE = (0x080, *CONTACT_TPDOS, 0x480, 0x580, 0x700)
STORM_FRAMES = 2000
BUS_OFF_US = 600_000
HOST_BUS_OFF_US = 400_000
BOOT_DELAY_US = 300_000

Records = list[LogRecord]
Scenario = Callable[[Records], Records]


def on_fd_bus(config: HandConfig) -> HandConfig:
    """Return the hand on a CAN FD bus."""
    bus = msgspec.structs.replace(config.bus, data_bitrate=5_000_000)
    return msgspec.structs.replace(config, bus=bus)


def is_of(record: LogRecord, node: int) -> bool:
    """Whether this node sent the frame."""
    return record.frame.can_id - node in SENT_BY_NODE


def is_contact(record: LogRecord) -> bool:
    """Return whether the frame is a TPDO of a fingertip's contact."""
    return any(record.frame.can_id - base in TIPS for base in CONTACT_TPDOS)


def is_from_nodes(record: LogRecord) -> bool:
    """Whether some node but the host sent it."""
    return any(is_of(record, node) for node in (*range(1, 10), *TIPS))


def upto(records: Records, seconds: float) -> Records:
    return [record for record in records if record.stamp_us < START_US + seconds * 1e6]


def in_order(records: Records) -> Records:
    return sorted(records, key=lambda record: record.stamp_us)


def delayed(records: Records, by_us: int) -> Records:
    return [replace(record, stamp_us=record.stamp_us + by_us) for record in records]


def read_again(records: Records, node: int, from_us: int) -> Records:
    """Responses to the host's reads of a node that is verified again from `from_us` on: those of its start.

    The host asks once a tick, beginning with the tick after the node's first heartbeat.
    """
    answers = [r for r in records if r.frame.can_id == 0x580 + node]
    ticks_us = [r.stamp_us for r in records if r.frame.can_id == 0x080]
    first_us = max(tick_us for tick_us in ticks_us if tick_us < answers[0].stamp_us)
    again_us = min(tick_us for tick_us in ticks_us if tick_us > from_us)
    return delayed(answers, again_us - first_us)


def start_up(records: Records) -> Records:
    """finger-3 boots 0.3 s late, is read later by as much, and sends its contacts from then on."""
    own = [r for r in records if is_of(r, FINGER_3)]
    said = delayed([r for r in own if not is_contact(r)], BOOT_DELAY_US)
    operates_us = next(r.stamp_us for r in said if r.frame == CanFrame(0x700 + FINGER_3, b"\x05"))
    contacts = [r for r in own if is_contact(r) and r.stamp_us >= operates_us]
    others = [r for r in records if not is_of(r, FINGER_3)]
    return upto(in_order([*others, *said, *contacts]), 1.2)


def fingertip_lost(records: Records) -> Records:
    """finger-3 says nothing from FAULT_US on."""
    return [r for r in records if not is_of(r, FINGER_3) or r.stamp_us < FAULT_US]


def bus_off(records: Records) -> Records:
    """finger-2's controller is off the bus for BUS_OFF_US; then the host reads it again."""
    cut = range(FAULT_US, FAULT_US + BUS_OFF_US)
    kept = [r for r in records if not is_of(r, FINGER_2) or r.stamp_us not in cut]
    beats = [r.stamp_us for r in kept if r.frame.can_id == 0x700 + FINGER_2 and r.stamp_us >= cut.stop]
    return upto(in_order([*kept, *read_again(records, FINGER_2, beats[0])]), 3.6)


def host_cut_off(records: Records) -> Records:
    """The host's controller is off the bus: it hears nobody for HOST_BUS_OFF_US."""
    cut = range(FAULT_US, FAULT_US + HOST_BUS_OFF_US)
    return upto([r for r in records if not is_from_nodes(r) or r.stamp_us not in cut], 3.0)


def late(records: Records) -> Records:
    """Contact TPDOs come 5 to 40 ms late, those of a frame together."""
    dice, delay_us, out = Random(1), dict.fromkeys(TIPS, 0), []
    for record in records:
        if is_contact(record):
            node = record.frame.can_id & 0x7F
            if record.frame.can_id - node == CONTACT_TPDOS[0]:
                delay_us[node] = dice.randint(5_000, 40_000)
            record = replace(record, stamp_us=record.stamp_us + delay_us[node])  # noqa: PLW2901
        out.append(record)
    return upto(in_order(out), 3.0)


def duplicated(records: Records) -> Records:
    """One contact TPDO in five comes twice, as after an error in its last bit (sent again at once)."""
    dice = Random(2)
    copies = [r for r in records if is_contact(r) and dice.random() < 0.2]
    return upto(in_order([*records, *copies]), 3.0)


def reordered(records: Records) -> Records:
    """Each contact TPDO is held back for up to 8 ms by itself: parts of a frame overtake each other."""
    dice = Random(3)
    moved = [
        replace(r, stamp_us=r.stamp_us + dice.randint(0, 8_000)) if is_contact(r) else r for r in records
    ]
    return upto(in_order(moved), 4.0)


def lossy(records: Records) -> Records:
    """One contact TPDO in ten is lost."""
    dice = Random(4)
    return upto([r for r in records if not is_contact(r) or dice.random() >= 0.1], 3.0)


def node_id_clash(records: Records) -> Records:
    """A second device with finger-2's id boots at FAULT_US, is read and sends contacts of its own."""
    clash: Records = [LogRecord(FAULT_US, CanFrame(0x700 + FINGER_2, b"\x00"))]
    for number in range(40):
        stamp_us = FAULT_US + 20_000 + 33_333 * number
        clash += [
            LogRecord(stamp_us, CanFrame(0x180 + FINGER_2, bytes.fromhex("0000 0000 b80b d007"))),
            LogRecord(stamp_us + 1, CanFrame(0x280 + FINGER_2, bytes.fromhex("0000 0000 0000 05ff"))),
            LogRecord(
                stamp_us + 2,
                CanFrame(0x300 + FINGER_2, number.to_bytes(2, "little") + bytes.fromhex("0080 0080 0080")),
            ),
            LogRecord(
                stamp_us + 3,
                CanFrame(
                    0x380 + FINGER_2,
                    (stamp_us - 4000 & 0xFFFFFFFF).to_bytes(4, "little")
                    + number.to_bytes(2, "little")
                    + (4000).to_bytes(2, "little"),
                ),
            ),
        ]
    return upto(in_order([*records, *clash, *read_again(records, FINGER_2, FAULT_US)]), 3.2)


def emcy_storm(records: Records) -> Records:
    """finger-3 sends STORM_FRAMES emergencies within a second."""
    storm = [
        LogRecord(FAULT_US + 500 * number, CanFrame(0x080 + FINGER_3, bytes.fromhex("01ff810000000000")))
        for number in range(STORM_FRAMES)
    ]
    return upto(in_order([*records, *storm]), 3.0)


def sync_jitter(records: Records) -> Records:
    """Each SYNC, and with it every drive's answer to it, comes up to 3 ms late."""
    dice, delay_us, out = Random(5), 0, []
    for record in records:
        if record.frame.can_id == 0x080:
            delay_us = dice.randint(0, 3_000)
        if record.frame.can_id == 0x080 or record.frame.can_id in range(0x181, 0x18A):
            record = replace(record, stamp_us=record.stamp_us + delay_us)  # noqa: PLW2901
        out.append(record)
    return upto(in_order(out), 3.0)


SCENARIOS: dict[str, Scenario] = {
    "start-up": start_up,
    "normal": lambda records: upto(records, 3.0),
    "fingertip-lost": fingertip_lost,
    "bus-off": bus_off,
    "host-cut-off": host_cut_off,
    "late": late,
    "duplicated": duplicated,
    "reordered": reordered,
    "lossy": lossy,
    "node-id-clash": node_id_clash,
    "emcy-storm": emcy_storm,
    "sync-jitter": sync_jitter,
}
