"""A console as a process, and a page's requests to it."""

from __future__ import annotations

import http.client
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

PATIENCE_S = 60.0


class Watch:
    """``palpate-edge watch`` on a free port, with one client that keeps what the stream brings."""

    def __init__(self, config: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "palpate_edge.cli.main", "watch", "--config", str(config), "--port", "0"],
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        self.lines: list[str] = []
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.lines.append(line.rstrip())
            if line.startswith("to watch:"):
                break
        assert self.lines[-1].startswith("to watch:"), self.lines
        self.url = self.lines[-2].removeprefix("to command:").strip()
        self.port = int(self.url.split(":")[2].split("/")[0])
        self.token = self.url.split("token=")[1]
        self.newest: dict[str, Any] = {}
        self.counts: dict[str, int] = {}
        self._is_watching = False

    def look(self) -> None:
        """Open the stream and keep its newest events from now on."""
        self._is_watching = True
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def look_away(self) -> None:
        self._is_watching = False
        self._thread.join(PATIENCE_S)

    def command(self, command: str, token: str | None = None, **values: Any) -> tuple[int, str]:
        """Status and text of a command."""
        headers = {"Content-Type": "application/json", "Authorization": f"Bearer {token or self.token}"}
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)) as connection:
            connection.request("POST", "/command", json.dumps({"command": command, **values}), headers)
            response = connection.getresponse()
            answer = json.load(response)
            return response.status, answer.get("text", answer.get("refused"))

    def until(self, condition: Callable[[], Any], what: str) -> float:
        """Wait; return after how many seconds the condition held."""
        begun_s = time.monotonic()
        while not condition():
            assert self.process.poll() is None, self.lines
            assert time.monotonic() < begun_s + PATIENCE_S, f"{what}: {self.newest.get('state')}"
            time.sleep(0.01)
        return time.monotonic() - begun_s

    def close(self) -> None:
        if self._is_watching:
            self.look_away()
        if self.process.poll() is None:
            self.process.terminate()
            assert self.process.wait(PATIENCE_S) == 0
        assert self.process.stderr is not None
        self.process.stderr.close()

    def _follow(self) -> None:
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)) as connection:
            connection.request("GET", "/events")
            response = connection.getresponse()
            kind = ""
            while self._is_watching and (line := response.readline()):
                if line.startswith(b"event: "):
                    kind = line[7:].strip().decode()
                elif line.startswith(b"data: "):
                    self.newest[kind] = json.loads(line[6:])
                    self.counts[kind] = self.counts.get(kind, 0) + 1


@pytest.fixture
def start_watch() -> Iterator[Callable[[Path], Watch]]:
    """Start a console for a configuration; it ends with the test."""
    started: list[Watch] = []

    def start(config: Path) -> Watch:
        started.append(Watch(config))
        return started[-1]

    yield start
    for watch in started:
        watch.close()
