"""Traffic of a large hand on CAN FD: 10 fingertips at 120 frames a second and 3 x 5 drives at 250 Hz.

The payloads are those of a recorded demo: contacts of its fingertips one after the other up to the length of
an FD frame, and the drives' own. Drives answer at the SYNC, all at once; fingertips send at times of their
own. Drives have a node each, or those of a finger are five axes of one.
"""

from __future__ import annotations

import gzip
from collections import defaultdict
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

from palpate_bus.logs.candump import parse_log
from palpate_edge.can_bus.can_frame import CanFrame, padded

RECORDED = Path(__file__).parents[2] / "replay" / "demo.log.gz"
FINGERTIPS, DRIVES = range(0x10, 0x1A), range(1, 16)
HOST = 0x7F
AXES = 5
AXES_NODES = range(1, 4)
FRAMES_HZ, TICK_HZ = 120, 250

Timed = tuple[int, int, CanFrame]  # time in us, node that sends, frame


def large_hand(contact_bytes: int, *, axes: bool = False) -> list[Timed]:
    """Return one second of traffic in the order of time.

    contact_bytes: length of a fingertip's FD frame. axes: the drives are axes of three nodes.
    """
    recorded = _payloads()
    contacts = _cut(
        b"".join(part for base in (0x190, 0x290, 0x390) for part in recorded[base]), contact_bytes
    )
    details, sdo = cycle(recorded[0x490]), cycle(recorded[0x581])
    sent: list[Timed] = []
    for place, node in enumerate(FINGERTIPS):
        phase_us = 797 * place
        sent += [(at, node, _fd(0x400 + node, next(contacts))) for at in _times(FRAMES_HZ, phase_us)]
        sent += [(at, node, CanFrame(0x480 + node, next(details))) for at in _times(1, phase_us)]
    sent += _of_axes(recorded) if axes else _of_drives(recorded)
    sent += [(at, HOST, CanFrame(0x080)) for at in _times(TICK_HZ)]
    sent += [(at, HOST, CanFrame(0x1FF, at.to_bytes(4, "little"))) for at in _times(20)]
    for node in (*FINGERTIPS, *(AXES_NODES if axes else DRIVES), HOST):
        sent += [(at, node, CanFrame(0x700 + node, b"\x05")) for at in _times(10, 31 * node)]
    sent += [(at, HOST, CanFrame(0x610, next(sdo))) for at in _times(40, 500)]
    return sorted(sent, key=lambda one: one[0])


def _of_drives(recorded: dict[int, list[bytes]]) -> Iterator[Timed]:
    drives = {base: cycle(recorded[base]) for base in (0x181, 0x201, 0x281)}
    for node in DRIVES:
        for base, hertz, sender in ((0x181, TICK_HZ, node), (0x201, TICK_HZ, HOST), (0x281, 10, node)):
            yield from ((at, sender, _fd(base - 1 + node, next(drives[base]))) for at in _times(hertz))


def _of_axes(recorded: dict[int, list[bytes]]) -> Iterator[Timed]:
    """Yield the frames of the nodes: statusword, position and velocity, torque of each axis; controlword and
    target of each. In the recorded frames the mode is the third byte."""
    motion, status, command = (cycle(recorded[base]) for base in (0x181, 0x281, 0x201))

    def state_of_axis() -> bytes:
        word = next(status)
        return word[:2] + next(motion) + word[3:]

    def command_of_axis() -> bytes:
        word = next(command)
        return word[:2] + word[3:]

    for node in AXES_NODES:
        for at in _times(TICK_HZ):
            state = b"".join(state_of_axis() for _ in range(AXES))
            yield at, node, _fd(0x180 + node, padded(state))
            yield at, HOST, _fd(0x200 + node, padded(b"".join(command_of_axis() for _ in range(AXES))))


def _payloads() -> dict[int, list[bytes]]:
    """Return the recorded payloads by the identifier of the first node that sends them."""
    payloads: dict[int, list[bytes]] = defaultdict(list)
    for record in parse_log(RECORDED, gzip.decompress(RECORDED.read_bytes()), skip_foreign=True).records:
        can_id = record.frame.can_id
        first = 0x10 if can_id & 0x7F in FINGERTIPS else 0x01
        payloads[(can_id & ~0x7F) | first].append(record.frame.data)
    return payloads


def _cut(data: bytes, length: int) -> Iterator[bytes]:
    return cycle([data[at : at + length] for at in range(0, len(data) - length, length)])


def _times(hertz: int, phase_us: int = 0) -> range:
    return range(phase_us % (1_000_000 // hertz), 1_000_000, 1_000_000 // hertz)


def _fd(can_id: int, data: bytes) -> CanFrame:
    return CanFrame(can_id, data, fd=True)
