"""Instructions of a fingertip's daemon for each frame, and from its start to the first contact.

python -m bench instructions

Valgrind counts the instructions of this machine's processor, without the kernel's. Unlike times they hardly
depend on the machine's load and speed. A frame goes through the daemon's parts in one thread
(daemon_frames.py). The difference of two runs leaves the start out. `HELD` are the counts of the last
improvement with Python 3.11; tests/bench/test_instructions.py (x86-64) and tests/deploy/test_aarch64.py (the
board's own Python and wheels, emulated) allow 10 % more.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from bench.estimate_to_bus import hub
from bench.frames import demo_material
from palpate_edge.calibration.calibration_file import save_calibration

FEW, MANY = 20, 60  # frames of the two runs
MILLION = 1e6
CLI = "palpate_edge.cli.main"
HELD = {
    "Python alone": 37.0,
    "start: imports of the daemon": 800.0,
    "start: to the first contact": 1060.0,
    "palpate-edge run, one frame, end": 1330.0,
    "a frame, the camera's own grey": 2.45,
    "a frame, decoded from JPEG": 7.4,
}
"""10^6 instructions of each part, x86-64. A count that falls by more than 5 % is written here."""
HELD_AARCH64 = {
    "Python alone": 29.4,
    "start: imports of the daemon": 660.0,
    "start: to the first contact": 880.0,
    "palpate-edge run, one frame, end": 1070.0,
    "a frame, the camera's own grey": 2.3,
    "a frame, decoded from JPEG": 6.55,
}
"""The same on aarch64, with Debian 12's Python and the wheels of a board."""
ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
COUNT = ("valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null")
START_TO_CONTACT = """
import sys
from pathlib import Path
import palpate_edge.daemon.daemon
import numpy as np
from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.estimator import Estimator
estimator = Estimator(load_calibration(Path(sys.argv[1])))
contact = estimator.estimate(Frame(np.load(sys.argv[2])[0], 0, 0, ""))
assert contact.valid, contact.reason
"""
DAEMON = """
name = "bench"
health = "{health}"
[capture]
source = "recorded"
path = "frame.png"
[estimator]
calibration = "bench.cal"
[node]
id = 0x10
[bus]
interface = "palpate"
channel = "{channel}"
"""


Count = Callable[..., int]
"""Runs Python with these words and returns its instructions."""


class Counter:
    """Counts the instructions of Python programs, whose modules are compiled before, as on a board.

    folder: keeps the compiled modules.
    """

    def __init__(self, folder: Path) -> None:
        variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        self._environment = {**variables, **ENVIRONMENT, "PYTHONPYCACHEPREFIX": str(folder / "compiled")}

    def run(self, *command: str | Path) -> int:
        """Return the instructions of the second of two runs. Raises RuntimeError when the program fails."""
        python = [sys.executable, *map(str, command)]
        for words in (python, [*COUNT, *python]):
            done = subprocess.run(words, capture_output=True, text=True, check=False, env=self._environment)
            if done.returncode:
                raise RuntimeError(f"{' '.join(words)}: {done.stderr[-2000:]}")
        found = re.search(r"I\s+refs:\s+([\d,]+)", done.stderr)
        if found is None:
            raise RuntimeError(f"valgrind printed no count: {done.stderr[-2000:]}")
        return int(found[1].replace(",", ""))


class Measured(NamedTuple):
    """Instructions of one part of the daemon, beside those that are held."""

    name: str
    count: int
    held: int


def by_valgrind(folder: Path) -> Count:
    """Return a counter for this Python; valgrind is there."""
    return Counter(folder).run


def measure(
    counter: Callable[[Path], Count] = by_valgrind, held: Mapping[str, float] = HELD
) -> list[Measured]:
    """Count every part in `held`. counter: makes the counter, with a folder for compiled modules."""
    material = demo_material()
    with tempfile.TemporaryDirectory() as work, hub() as channel:
        folder = Path(work)
        count = counter(folder)
        save_calibration(material.calibration, folder / "bench.cal")
        grey = np.array([cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE) for jpeg in material.jpegs[:MANY]])
        np.save(folder / "grey.npy", grey)
        cv2.imwrite(str(folder / "frame.png"), grey[0])
        config = folder / "finger.toml"
        config.write_text(DAEMON.format(channel=channel, health=folder / "health.json"), encoding="utf-8")
        files = folder / "bench.cal", folder / "grey.npy"
        counts = {
            "Python alone": count("-c", "pass"),
            "start: imports of the daemon": count("-c", "import palpate_edge.daemon.daemon"),
            "start: to the first contact": count("-c", START_TO_CONTACT, *files),
            "palpate-edge run, one frame, end": count(
                "-m", "palpate_edge.cli.main", "run", "--config", config
            ),
        }
        for kind, name in (("grey", "the camera's own grey"), ("jpeg", "decoded from JPEG")):
            run = ("-m", "bench.daemon_frames", kind)
            few, many = (count(*run, str(frames), folder, channel) for frames in (FEW, MANY))
            counts[f"a frame, {name}"] = (many - few) // (MANY - FEW)
    return [Measured(name, total, round(held[name] * MILLION)) for name, total in counts.items()]


def report() -> str:
    """Return the table; one line where valgrind is missing."""
    if shutil.which("valgrind") is None:
        return "instructions: valgrind is missing (apt install valgrind)"
    return table(measure(), platform.machine())


def table(rows: list[Measured], machine: str) -> str:
    """Return counts beside those that are held."""
    lines = [f"Instructions of a fingertip's daemon, 10^6, {machine}: {demo_material().name}"]
    lines += [f"{'':<36}{'counted':>10}{'held':>10}"]
    for row in rows:
        lines.append(f"{row.name:<36}{row.count / MILLION:>10.2f}{row.held / MILLION:>10.2f}")
    return "\n".join(lines)
