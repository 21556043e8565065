"""The cost of ``palpate-edge watch``: processor shares and dropped frames while two clients watch.

python -m bench.console [--seconds 20] [--rounds 5]

A daemon plays the demo's recording of finger 1 (640x480, 30 frames/s) on a hub. Rounds without and with two
clients, each at 10 pictures a second, alternate. At the end the daemon is killed, and the time until a client
has the news is measured. Prints the table of docs/console.md.
"""

from __future__ import annotations

import argparse
import http.client
import json
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[1]
CLIENTS = 2
TICKS_S = os.sysconf("SC_CLK_TCK")
CONFIG = """name = "bench"
health = "{folder}/bench.health"
[capture]
source = "recorded"
path = "{root}/demo/recording/finger-1/frames.webm"
loop = true
[estimator]
calibration = "{folder}/finger.cal"
[node]
id = 16
[bus]
interface = "palpate"
channel = "{folder}/hub.sock"
"""


class Client:
    """A page's stream without the page: counts pictures, and when the fingertip was lost."""

    def __init__(self, port: int) -> None:
        self.pictures = 0
        self.lost_at_s = 0.0
        self._ended = False
        self._thread = threading.Thread(target=self._follow, args=(port,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended = True
        self._thread.join()

    def _follow(self, port: int) -> None:
        with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=30)) as connection:
            connection.request("GET", "/events")
            response = connection.getresponse()
            while not self._ended and (line := response.readline()):
                if line == b"event: frame\n":
                    self.pictures += 1
                elif line.startswith(b'data: {"connected":false') and not self.lost_at_s:
                    self.lost_at_s = time.monotonic()


@dataclass
class Shares:
    """Figures of the rounds of one kind, one value a round."""

    daemon_percent: list[float] = field(default_factory=list)
    console_percent: list[float] = field(default_factory=list)
    dropped: list[int] = field(default_factory=list)
    pictures_s: list[float] = field(default_factory=list)


def busy_s(process: subprocess.Popen[str]) -> float:
    """Processor time of all threads of a process since its start."""
    words = Path(f"/proc/{process.pid}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(words[11]) + int(words[12])) / TICKS_S


def start(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", *arguments]
    return subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"}
    )


def until_line(process: subprocess.Popen[str], begin: str) -> str:
    assert process.stderr is not None
    for line in process.stderr:
        if begin in line:
            return line
    raise SystemExit(f"{process.args} ended")


@contextmanager
def running_fingertip(folder: Path) -> Iterator[tuple[Path, subprocess.Popen[str]]]:
    """Yield the configuration and the process of a daemon on a hub, which plays the recording."""
    config = folder / "finger.toml"
    config.write_text(CONFIG.format(folder=folder, root=ROOT))
    calibrate = ["palpate_edge.cli.main", "calibrate", str(ROOT / "demo/recording/press")]
    subprocess.run(
        [sys.executable, "-m", *calibrate, "-o", str(folder / "finger.cal")],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    hub = start("palpate_host.cli.main", "bus", "hub", "--socket", str(folder / "hub.sock"))
    until_line(hub, "listening")
    daemon = start("palpate_edge.cli.main", "run", "--config", str(config))
    try:
        until_line(daemon, "node 0x10")
        yield config, daemon
    finally:
        for process in (daemon, hub):
            process.terminate()
            process.wait()
            assert process.stderr is not None
            process.stderr.close()


def until_end_is_shown_s(port: int, process: subprocess.Popen[str]) -> float:
    """Kill a process whose console is at `port`, and return the time in s until a client loses it."""
    client = Client(port)
    time.sleep(2)
    killed_s = time.monotonic()
    process.kill()
    while not client.lost_at_s:
        time.sleep(0.001)
    client.close()
    return client.lost_at_s - killed_s


def measure(folder: Path, seconds: float, rounds: int) -> tuple[dict[int, Shares], float]:
    """Return the figures without (0) and with clients, and the time in s until the daemon's end is shown."""
    with running_fingertip(folder) as (config, daemon):
        watch = start("palpate_edge.cli.main", "watch", "--config", str(config), "--port", "0")
        try:
            port = int(until_line(watch, "to watch").split(":")[-1].strip(" /\n"))
            time.sleep(5)
            figures = {0: Shares(), CLIENTS: Shares()}
            for _ in range(rounds):
                for count, shares in figures.items():
                    clients = [Client(port) for _ in range(count)]
                    _round(shares, clients, (daemon, watch), folder, seconds)
            return figures, until_end_is_shown_s(port, daemon)
        finally:
            watch.terminate()
            watch.wait()


def _round(
    shares: Shares,
    clients: list[Client],
    processes: tuple[subprocess.Popen[str], subprocess.Popen[str]],
    folder: Path,
    seconds: float,
) -> None:
    time.sleep(1.5)  # the health file is a second old at most
    before_s, dropped = [busy_s(process) for process in processes], dropped_frames(folder)
    shown, begun_s = sum(client.pictures for client in clients), time.monotonic()
    time.sleep(seconds)
    lasted_s = time.monotonic() - begun_s
    used = [
        100 * (busy_s(process) - was_s) / lasted_s for process, was_s in zip(processes, before_s, strict=True)
    ]
    pictures = sum(client.pictures for client in clients) - shown
    time.sleep(1.5)
    shares.daemon_percent.append(used[0])
    shares.console_percent.append(used[1])
    shares.dropped.append(dropped_frames(folder) - dropped)
    shares.pictures_s.append(pictures / lasted_s / max(1, len(clients)))
    for client in clients:
        client.close()


def dropped_frames(folder: Path) -> int:
    return int(json.loads((folder / "bench.health").read_bytes())["camera"]["dropped"])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        figures, lost_s = measure(Path(folder), options.seconds, options.rounds)
    frames = round(30 * options.seconds * options.rounds)
    print("| clients | pictures/s each | daemon, % of a core | console, % of a core | dropped frames |")
    print("|---|---:|---:|---:|---:|")
    for count, shares in figures.items():
        daemon, console = statistics.median(shares.daemon_percent), statistics.median(shares.console_percent)
        pictures = statistics.median(shares.pictures_s)
        print(
            f"| {count} | {pictures:.1f} | {daemon:.1f} | {console:.1f} | {sum(shares.dropped)} of {frames} |"
        )
    print(f"the end of a killed daemon reached a client after {1000 * lost_s:.0f} ms")


if __name__ == "__main__":
    main()
