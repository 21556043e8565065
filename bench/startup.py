"""Measure the time from a fingertip's start to its first estimate, and its memory, in new processes.

Start-up time: a new Python process imports the daemon's modules, reads the calibration with its model and the
first frame of a recording, and estimates a contact. Memory: `palpate-edge run` with that recording.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from bench.frames import RECORDING, demo_material
from palpate_edge.calibration.calibration_file import save_calibration

MOST_S, MOST_MB = 1.5, 150.0  # limits
STARTS = 7
HUB_S, RUN_S = 1.0, 8.0  # time to start the hub, duration of the run
FINGER = RECORDING / "finger-1"
FIRST_ESTIMATE = """
import sys
from pathlib import Path
import palpate_edge.daemon.daemon
from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.datasets.recording import all_frames, open_recording
from palpate_edge.estimation.estimator import Estimator

estimator = Estimator(load_calibration(Path(sys.argv[1])))
contact = estimator.estimate(next(iter(all_frames(open_recording(Path(sys.argv[2]))))))
assert contact.valid, contact.reason
print("estimated", flush=True)
sys.stdin.read()
"""
RUN = "from palpate_edge.cli.main import main; main()"
HUB = "from palpate_host.cli.main import main; main()"
DAEMON = """
name = "bench"
[capture]
source = "recorded"
path = "{path}"
loop = true
[estimator]
calibration = "bench.cal"
[node]
id = 0x10
[bus]
interface = "palpate"
channel = "{folder}/hub"
"""


def report() -> str:
    """Return the figures with their limits as text."""
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work)
        save_calibration(demo_material().calibration, folder / "bench.cal")
        starts_s = [_start_s(folder / "bench.cal") for _ in range(STARTS)][1:]
        rss_mb, peak_mb = _memory_mb(folder)
    return "\n".join(
        [
            "A fingertip's daemon in a new process, elapsed time",
            f"imports and first estimate  {np.median(starts_s):6.2f} s median of {len(starts_s)}, "
            f"{max(starts_s):.2f} s at most (limit {MOST_S:g} s)",
            f"resident memory with the model after {RUN_S:g} s  {rss_mb:6.1f} MB, "
            f"{peak_mb:.1f} MB at most (limit {MOST_MB:g} MB)",
        ]
    )


def _start_s(calibration: Path) -> float:
    """Return the time in s from the process's start to its first estimate."""
    begin = time.monotonic()
    command = [sys.executable, "-c", FIRST_ESTIMATE, str(calibration), str(FINGER)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        line = child.stdout.readline()
        elapsed_s = time.monotonic() - begin
    if line != b"estimated\n":
        raise RuntimeError(f"the first estimate failed with status {child.returncode}")
    return elapsed_s


def _memory_mb(folder: Path) -> tuple[float, float]:
    """Return the daemon's resident memory after `RUN_S` and its maximum, in 10^6 bytes."""
    config = folder / "fingertip.toml"
    config.write_text(DAEMON.format(path=FINGER, folder=folder), encoding="utf-8")
    with _running(HUB, "bus", "hub", "--socket", str(folder / "hub")):
        time.sleep(HUB_S)
        with _running(RUN, "run", "--config", str(config)) as daemon:
            time.sleep(RUN_S)
            status = Path(f"/proc/{daemon.pid}/status").read_text(encoding="ascii")
    kilobytes = dict(re.findall(r"(VmRSS|VmHWM):\s+(\d+) kB", status))
    return 1.024e-3 * int(kilobytes["VmRSS"]), 1.024e-3 * int(kilobytes["VmHWM"])


@contextmanager
def _running(program: str, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-c", program, *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
