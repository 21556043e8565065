"""``palpate-host console`` as a process."""

from __future__ import annotations

import http.client
import json
import os
import subprocess
import time
from contextlib import closing, suppress
from pathlib import Path

from tests.host.hand_on_hub import CLI, PATIENCE_S


class ConsoleProcess:
    """``palpate-host console`` on a free port, beside a host with a control socket."""

    def __init__(self, config: Path, socket: Path, recordings: Path):
        self.config, self.socket = config, socket
        self.process = subprocess.Popen(
            [
                *(*CLI, "console", "--config", str(config), "--socket", str(socket)),
                *("--recordings", str(recordings), "--port", "0"),
            ],
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "XDG_RUNTIME_DIR": str(config.parent)},
        )
        lines = [self.process.stderr.readline() for _ in range(2)]
        assert lines[1].startswith("to watch:"), lines
        self.url = lines[0].removeprefix("to command:").strip()
        self.port = int(self.url.split(":")[2].split("/")[0])
        self.token = self.url.split("token=")[1]

    def command(self, token=None, **body):
        """Status and text of a command."""
        headers = {"Content-Type": "application/json", "Authorization": f"Bearer {token or self.token}"}
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)) as connection:
            connection.request("POST", "/command", json.dumps(body), headers)
            response = connection.getresponse()
            answer = json.load(response)
            return response.status, answer.get("text", answer.get("refused"))

    def event(self, wanted, what):
        """The first event (kind, value) that is wanted."""
        end_s = time.monotonic() + PATIENCE_S
        with closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)) as connection:
            connection.request("GET", "/events")
            response = connection.getresponse()
            kind = ""
            while line := response.readline():
                assert time.monotonic() < end_s, what
                if line.startswith(b"event: "):
                    kind = line[7:].strip().decode()
                elif line.startswith(b"data: ") and wanted(kind, value := json.loads(line[6:])):
                    return value
        raise AssertionError(what)

    def mode(self, *names):
        """The first status in one of these modes, with its scene."""
        found = self.event(lambda kind, value: kind == "hand" and value["status"]["mode"] in names, names)
        return found["status"], found["scene"]

    def lead_to(self, mode, **command):
        """Send a command until the hand is in this mode; a busy machine may stop it meanwhile."""
        end_s = time.monotonic() + PATIENCE_S
        starting = ("init", "check", "home")
        while (status := self.mode_now())["mode"] != mode:
            assert time.monotonic() < end_s, status
            if status["mode"] in ("fault", "stop"):
                self.command(command="recover")
            elif status["mode"] not in starting:
                self.command(**command)
            time.sleep(0.2)
        return self.mode(mode)

    def mode_now(self):
        return self.event(lambda kind, _value: kind == "hand", "no status")["status"]

    def close(self):
        self.process.terminate()
        with suppress(subprocess.TimeoutExpired):
            assert self.process.wait(PATIENCE_S) in (0, -9)
        self.process.stderr.close()
