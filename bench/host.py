"""Time of one host tick on a recorded demo, from received frames to torques."""

from __future__ import annotations

import gc
import gzip
import tempfile
import time
from pathlib import Path

import numpy as np

import palpate_host
from bench.timing import Row, table, time_each
from palpate_bus.logs.candump import read_log
from palpate_edge.common.gc_freeze import long_lived
from palpate_host.config.hand_config import StartMode
from palpate_host.service.host import load_hand
from palpate_host.service.host_core import HostCore
from palpate_host.service.replay import has_reads, replay

ROOT = Path(__file__).resolve().parents[1]
LOG = ROOT / "tests" / "replay" / "demo.log.gz"
TABLE_4 = Path(palpate_host.__file__).parent / "models" / "table4.toml"
COLLECTIONS = 20


class TimedCore(HostCore):
    """HostCore that stores the duration of each call that ended a tick."""

    seconds: list[float] = []  # noqa: RUF012 - collected over the whole replay

    def process(self, now_us, frames_in):
        begin = time.perf_counter()
        output = super().process(now_us, frames_in)
        if output.status is not None:
            self.seconds.append(time.perf_counter() - begin)
        return output


def report() -> str:
    """Return the table."""
    return table("Host, 3 fingers x 3 joints", rows())


def rows() -> list[Row]:
    """Return the rows; the reference is the first: MuJoCo's kinematics, Jacobians and gravity."""
    loaded, hand = load_hand(TABLE_4)
    config = loaded.starting(StartMode.AUTO)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "demo.log"
        path.write_bytes(gzip.decompress(LOG.read_bytes()))
        records = read_log(path).records
    replay(records, config, hand, core=TimedCore(config, hand, verifies=has_reads(records, config)))
    angles = np.random.default_rng(0).uniform(-0.3, 0.3, (500, hand.joint_count))
    full_s = time_each(lambda _: gc.collect(), range(COLLECTIONS))
    with long_lived():
        frozen_s = time_each(lambda _: gc.collect(), range(COLLECTIONS))
    return [
        Row("hand: tip positions, Jacobians, gravity (MuJoCo)", time_each(hand.pose, list(angles))),
        Row("whole tick with supervisor, frames and status", np.array(TimedCore.seconds)),
        Row("full garbage collection, start-up objects included", full_s),
        Row("full garbage collection in the loop (gc_freeze.py)", frozen_s),
    ]
