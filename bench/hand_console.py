"""The cost of ``palpate-host console``, and the time until a page has the news of a killed host.

python -m bench.hand_console [--seconds 8]

The hand of Table 4 with simulated drives, three fingertip nodes at 30 contacts/s and its host run on a hub.
Prints the console's processor share without a page and with one and two, and the figures of docs/console.md.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.console import ROOT, Client, busy_s, start, until_end_is_shown_s, until_line

TABLE_4 = ROOT / "host" / "palpate_host" / "models" / "table4.toml"
TIPS = ROOT / "tests" / "host" / "touching_fingertips.py"
HOST = "palpate_host.cli.main"


def measure(folder: Path, seconds: float) -> tuple[dict[int, float], float]:
    """Return the console's share of a core by the number of pages, and the time in s until a killed host is
    shown."""
    config, control = folder / "hand.toml", folder / "control"
    config.write_text(TABLE_4.read_text().replace("[bus]", f'[bus]\nchannel = "{folder}/hub"', 1))
    running: list[subprocess.Popen[str]] = []

    def add(until: str, *words: object) -> str:
        running.append(start(*map(str, words)))
        return until_line(running[-1], until) if until else ""

    try:
        add("listening", HOST, "bus", "hub", "--socket", folder / "hub")
        add("simulated drives", HOST, "drives", "--config", config)
        running.append(subprocess.Popen([sys.executable, str(TIPS), str(config)], text=True))
        add("", HOST, "run", "--config", config, "--start", "command", "--socket", control)
        host = running[-1]
        words = ("--config", config, "--socket", control, "--port", 0, "--recordings", folder / "recordings")
        port = int(add("to watch", HOST, "console", *words).split(":")[-1].strip(" /\n"))
        console = running[-1]
        time.sleep(5)
        shares = {}
        for count in range(3):
            pages = [Client(port) for _ in range(count)]
            time.sleep(2)
            before_s, begun_s = busy_s(console), time.monotonic()
            time.sleep(seconds)
            shares[count] = 100 * (busy_s(console) - before_s) / (time.monotonic() - begun_s)
            for page in pages:
                page.close()
        return shares, until_end_is_shown_s(port, host)
    finally:
        for process in reversed(running):
            process.terminate()
            process.wait()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=8.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        shares, lost_s = measure(Path(folder), options.seconds)
    print("| pages | console, % of a core |")
    print("|---:|---:|")
    for count, share in shares.items():
        print(f"| {count} | {share:.1f} |")
    print(f"the end of a killed host reached a page after {1000 * lost_s:.0f} ms")


if __name__ == "__main__":
    main()
