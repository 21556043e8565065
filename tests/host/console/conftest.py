"""A hand on the local hub with its host, and a console as a process."""

from __future__ import annotations

import subprocess
from contextlib import closing

import pytest
from tests.host.console_process import ConsoleProcess
from tests.host.hand_on_hub import CLI, Running, patient_hand, put_on_the_bus


class HandConsole(ConsoleProcess):
    """A console beside a host that waits for commands, which a test can kill."""

    def __init__(self, config, running):
        self._running, self._words = (
            running,
            ["--config", str(config), "--socket", str(config.with_name("s"))],
        )
        self.start_host()
        super().__init__(config, config.with_name("s"), config.with_name("recordings"))

    def start_host(self):
        self._running.processes["host"] = subprocess.Popen(
            [*CLI, "run", *self._words, "--start", "command"], stderr=subprocess.DEVNULL, text=True
        )

    def kill_host(self):
        self._running.kill("host")


@pytest.fixture
def console(tmp_path):
    running = Running()
    config = patient_hand(tmp_path)
    try:
        put_on_the_bus(running, config)
        with closing(HandConsole(config, running)) as console:
            yield console
    finally:
        running.stop()
