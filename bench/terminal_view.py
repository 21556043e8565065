"""The cost of ``palpate-edge watch --terminal``: processor share and bytes, by the terminal's colours.

python -m bench.terminal_view [--seconds 20] [--rounds 3]

A daemon plays the demo's recording of finger 1 (640x480, 30 frames/s) on a hub; a pseudo-terminal of 80 x 24
shows it. Prints the table of docs/console.md.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

from tests.terminal_process import DrawnScreen, TerminalProcess

from bench.console import busy_s, running_fingertip

SIZE = 80, 24
TERMINALS = {
    "24-bit": {"COLORTERM": "truecolor"},
    "256": {"COLORTERM": ""},
    "none, ASCII": {"NO_COLOR": "1"},
}
SETTLE_S = 3.0


class CountingScreen(DrawnScreen):
    """Counts the bytes that a terminal is sent."""

    received = 0

    def take(self, text: str) -> None:
        self.received += len(text.encode())
        super().take(text)


def measure(config: Path, environment: dict[str, str], seconds: float) -> tuple[float, float]:
    """Return the share of a core in percent and the kilobytes a second of one view."""
    command = [sys.executable, "-m", "palpate_edge.cli.main", "watch", "--terminal", "--config", str(config)]
    with closing(TerminalProcess(command, *SIZE, **environment)) as terminal:
        terminal.screen = screen = CountingScreen(*SIZE)
        terminal.until(lambda shown: "frames/s" in shown.text, "no frames")
        _wait(terminal, SETTLE_S)
        before_s, received, begun_s = busy_s(terminal.process), screen.received, time.monotonic()
        _wait(terminal, seconds)
        lasted_s = time.monotonic() - begun_s
        share = 100 * (busy_s(terminal.process) - before_s) / lasted_s
        return share, (screen.received - received) / lasted_s / 1000


def _wait(terminal: TerminalProcess, seconds: float) -> None:
    end_s = time.monotonic() + seconds
    terminal.until(lambda _: time.monotonic() > end_s, "unreachable")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    figures: dict[str, list[tuple[float, float]]] = {name: [] for name in TERMINALS}
    with tempfile.TemporaryDirectory() as folder, running_fingertip(Path(folder)) as (config, _):
        for _ in range(options.rounds):
            for name, environment in TERMINALS.items():
                figures[name].append(measure(config, environment, options.seconds))
    print("| colours | % of a core | kB/s |")
    print("|---|---:|---:|")
    for name, rounds in figures.items():
        share, kB_s = (statistics.median(column) for column in zip(*rounds, strict=True))
        print(f"| {name} | {share:.1f} | {kB_s:.1f} |")


if __name__ == "__main__":
    main()
