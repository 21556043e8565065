"""Processes of a hand on the local hub: everything but its host."""

import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

from palpate_host.config.packaged import MODELS

TIPS = Path(__file__).with_name("touching_fingertips.py")
CLI = [sys.executable, "-m", "palpate_host.cli.main"]
TABLE_4 = MODELS / "table4.toml"
PATIENCE_S = 60.0


class Running:
    """Processes that a test starts, by name."""

    def __init__(self):
        self.processes = {}

    def start(self, name, *command, until):
        process = subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True)
        self.processes[name] = process
        assert until in process.stderr.readline()

    def kill(self, name):
        process = self.processes.pop(name)
        process.kill()
        process.communicate(timeout=PATIENCE_S)

    def stop(self):
        for process in reversed(self.processes.values()):
            process.terminate()
            process.communicate(timeout=PATIENCE_S)


def patient(text):
    """Times for a machine that other tests share: what is tested here is who comes back, not when."""
    for key, patient_ms in (
        ("freeze_ms = 250", 1000),
        ("hold_ms = 1000", 2000),
        ("joint_stop_ms = 100", 2000),
        ("heartbeat_timeout_ms = 500", 3000),
    ):
        assert key in text
        text = text.replace(key, f"{key.split()[0]} = {patient_ms}")
    return text.replace("\nstop_ms = 3000", "\nstop_ms = 20000")


def patient_hand(folder, *bus_lines):
    """Write Table 4's hand on a hub in the folder, with those times and further lines in its [bus]."""
    path = folder / "hand.toml"
    bus = "\n".join(["[bus]", f'channel = "{folder / "hub"}"', *bus_lines])
    path.write_text(patient(TABLE_4.read_text().replace("[bus]", bus, 1)))
    return path


@contextmanager
def hand_on_the_bus(folder):
    """Run the drives and the touched fingertips of that hand, and its hub."""
    running = Running()
    try:
        put_on_the_bus(running, patient_hand(folder))
        yield folder
    finally:
        running.stop()


def put_on_the_bus(running, config, *hub_options):
    hub = config.with_name("hub")
    running.start("hub", *CLI, "bus", "hub", "--socket", hub, *hub_options, until="hub: listening")
    running.start("drives", *CLI, "drives", "--config", config, until="simulated drives")
    running.start("fingertips", sys.executable, TIPS, config, until="on the bus")
