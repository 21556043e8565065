"""Time from a frame's exposure to the resulting torque command, in parts, from the bus log of a run.

python -m bench.latency                  # runs a demo with recorded frames
python -m bench.latency demo/run/bus.log # evaluates an existing log

The parts of each complete contact are: processing (exposure to publication, from TPDO 3), bus (to TPDO 3 on
the bus), wait for the host's tick (its next SYNC), and tick with commands (to the last command on the bus).
Time stamps are those of the interface, exposures those of the bus clock.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.timing import Row, table
from palpate_bus.logs.candump import LogRecord
from palpate_host.config.hand_config import HandConfig
from palpate_host.network.nmt_master import SYNC
from palpate_host.service.host import load_hand
from palpate_host.service.replay import exposure_codecs, exposure_of, read_bound_log

ROOT = Path(__file__).resolve().parents[1]
RECORDING = ROOT / "demo" / "recording"
RPDO_1_ID = 0x200
DURATION_S = 20


def parts(records: Sequence[LogRecord], config: HandConfig) -> np.ndarray:
    """Return the parts (n, 4) in s of each contact: processing, bus, wait for the tick, tick and commands."""
    contacts = exposure_codecs([finger.fingertip_node for finger in config.fingers])
    commands = {RPDO_1_ID + joint.drive_node for joint in config.joints}
    found: list[tuple[int, int, int, int]] = []
    waiting: list[tuple[int, int, int]] = []  # exposed, published, on the bus
    used: list[tuple[int, int, int]] = []  # in the current tick
    tick_us = last_us = 0
    for record in records:
        stamp_us, frame = record.stamp_us, record.frame
        codec = contacts.get(frame.can_id)
        if codec is not None and len(frame.data) >= codec.length_bytes:
            exposed_us, latency_us = exposure_of(codec, record)
            waiting.append((exposed_us, exposed_us + latency_us, stamp_us))
        elif frame == SYNC:
            found += [(*times, tick_us, last_us) for times in used if last_us]
            used, waiting, tick_us, last_us = waiting, [], stamp_us, 0
        elif frame.can_id in commands:
            last_us = stamp_us
    times = np.array(found, dtype=np.float64)
    return np.diff(times, axis=1) * 1e-6


def report_of_a_demo() -> str:
    """Run a demo for `DURATION_S` with three fingertips, hub, drives and host, and return its table."""
    with tempfile.TemporaryDirectory() as name:
        command = [
            sys.executable,
            "-m",
            "palpate_host.cli.main",
            "demo",
            "--no-view",
            "--recording",
            RECORDING,
        ]
        options = ["--duration", str(DURATION_S), "--output", name]
        subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
        return report(Path(name) / "run" / "bus.log")


def report(log: Path, hand_toml: Path | None = None) -> str:
    """Return a table of the parts, and of processing and bus together. hand_toml: None for the one beside the
    log."""
    config, _ = load_hand(hand_toml or log.with_name("hand.toml"))
    processing, bus, wait, tick = parts(read_bound_log(log, config), config).T
    rows = [
        Row("exposure to torque", processing + bus + wait + tick),
        Row("of it: processing and bus together", processing + bus + tick),
        Row("  processing, as published by the fingertip", processing),
        Row("  contact on the bus", bus),
        Row(f"  wait for the host's tick at {config.control.tick_Hz} Hz", wait),
        Row("  tick and commands on the bus", tick),
    ]
    return table(f"Exposure to torque, {len(processing)} contacts of {log.name}", rows)


if __name__ == "__main__":
    paths = [Path(argument) for argument in sys.argv[1:]]
    print(report(*paths) if paths else report_of_a_demo())
