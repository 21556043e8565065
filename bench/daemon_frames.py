"""Frames through the parts of a fingertip's daemon in one thread, each with a virtual time of its own.

python -m bench.daemon_frames KIND COUNT FOLDER CHANNEL: a program for bench/instructions.py, with the imports
of the daemon alone. KIND: grey, frames as the camera gives them; jpeg, decoded here. FOLDER: of grey.npy and
bench.cal. CHANNEL: of the hub. Estimator, node and bus link are the daemon's.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import closing
from itertools import cycle, islice
from pathlib import Path

import cv2
import numpy as np

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.reconnecting_bus import ReconnectingBus
from palpate_edge.common.arrays import Image
from palpate_edge.common.frame import Frame
from palpate_edge.daemon.fingertip_core import FingertipCore
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import Health, MethodCode

FRAME_US = 33_333
START = CanFrame(0x000, b"\x01\x10")
HEALTH = Health(None, 0, 0)


def reader(folder: Path, kind: str) -> tuple[int, Callable[[int], Image]]:
    """Return the number of frames, and what reads one."""
    frames = np.load(folder / "grey.npy")
    if kind == "grey":
        return len(frames), lambda index: frames[index]
    jpegs = [cv2.imencode(".jpg", frame)[1] for frame in frames]
    return len(frames), lambda index: np.asarray(cv2.imdecode(jpegs[index], cv2.IMREAD_GRAYSCALE), np.uint8)


def publish(kind: str, count: int, folder: Path, channel: str) -> int:
    """Estimate `count` frames and send their contacts; return how many were valid."""
    length, read = reader(folder, kind)
    estimator = Estimator(load_calibration(folder / "bench.cal"))
    config, valid = BusConfig(interface="palpate", channel=channel), 0
    with closing(ReconnectingBus(lambda: open_bus(config, "fingertip"))) as link:
        core = FingertipCore(FingertipNode(0x10, MethodCode.CORRECTED, "0" * 16), 1_000_000, 0)
        link.send(0, core.poll(0).frames_out)
        core.receive(0, [(0, START)])
        for number, index in enumerate(islice(cycle(range(length)), count), 1):
            now_us = number * FRAME_US
            contact = estimator.estimate(Frame(read(index), now_us, number, ""))
            valid += contact.valid
            link.send(now_us, core.contact(now_us, contact))
            core.frame_seen(now_us, contact, HEALTH)
            link.receive(now_us)
            link.send(now_us, core.poll(now_us).frames_out)
    return valid


if __name__ == "__main__":
    cv2.setNumThreads(1)
    print(publish(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]), sys.argv[4]))
