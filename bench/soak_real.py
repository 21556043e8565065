"""Run the demo in real time and record the memory of its processes and the times of the host's SYNCs."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from bench.soak_virtual import resident_bytes
from palpate_bus.logs.candump import read_log
from palpate_host.network.nmt_master import SYNC
from palpate_twin.hand.motion import read_motion

SAMPLE_PERIOD_S = 10.0


def run(duration_s: float) -> tuple[dict[str, list[tuple[float, int]]], np.ndarray]:
    """Run the demo; return the memory of each process over time, and the times of the host's SYNCs.

    Memory: (seconds since the start, resident bytes) by name and pid. SYNC times are in seconds of the
    machine's clock. Raises CalledProcessError if the demo fails; its message is on stderr.
    """
    with tempfile.TemporaryDirectory() as name:
        words = ["demo", "--no-view", "--duration", str(duration_s), "--output", name]
        command = [sys.executable, "-m", "palpate_host.cli.main", *words]
        memory: dict[str, list[tuple[float, int]]] = defaultdict(list)
        begin_s = time.monotonic()
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as demo:
            while demo.poll() is None:
                for pid, part in _descendants(demo.pid).items():
                    try:
                        memory[f"{part} {pid}"].append((time.monotonic() - begin_s, resident_bytes(pid)))
                    except OSError:  # it has just ended
                        continue
                time.sleep(SAMPLE_PERIOD_S)
        if demo.returncode:
            raise subprocess.CalledProcessError(demo.returncode, command)
        records = read_log(Path(name) / "run" / "bus.log").records
        syncs_us = np.array([record.stamp_us for record in records if record.frame == SYNC])
        motion = read_motion(Path(name) / "run" / "truth" / "motion.csv")
        return memory, 1e-6 * (syncs_us + np.interp(syncs_us, motion.stamps_us, motion.held_us))


def _descendants(root: int) -> dict[int, str]:
    """Return the programs of all child processes of `root` by pid."""
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1])
            except OSError:  # it has just ended
                continue
    found: dict[int, str] = {}
    below = [root]
    while below:
        parent = below.pop()
        for pid in [pid for pid, its_parent in parents.items() if its_parent == parent]:
            found[pid] = _part(pid)
            below.append(pid)
    return found


def _part(pid: int) -> str:
    """Return program and command of a process, such as "palpate_edge run" or "palpate_host bus"."""
    try:
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return "ended"
    return " ".join(words[2:4]).replace(".cli.main", "") if words[1] == "-m" else "helper process"
