"""A hand that waits in CHECK because a fingertip differs: the command in its reason leads to READY.

Hub, drives, fingertips and host are processes; the command is run as the reason has it.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import time

import pytest
from tests.host.hand_on_hub import CLI, PATIENCE_S, Running, patient_hand, put_on_the_bus

from palpate_host.common.mode import Mode
from palpate_host.config import hand_reader
from palpate_host.operator.client import NoHostError, OperatorClient
from palpate_host.operator.protocol import Status

SWAP_X_AND_Y = (
    *(("1800:1", "0xC0000190"), ("1A00:0", "0"), ("1A00:1", "0x71300210"), ("1A00:2", "0x71300110")),
    *(("1A00:0", "4"), ("1800:1", "0x40000190"), ("1010:1", "save")),
)
FINGERTIP_HAS = {"calibration": "0" * 16, "serial": 0}
OTHERS = {"calibration": '"0123456789abcdef"', "software": '"0.0.9"', "serial": "43"}


pytestmark = pytest.mark.usefixtures("real_time")


@pytest.fixture
def config(tmp_path):
    return patient_hand(tmp_path)


@pytest.fixture
def running(config):
    made = Running()
    put_on_the_bus(made, config)
    yield made
    made.stop()


@pytest.fixture
def run(tmp_path):
    """Run a command line of palpate-host and return what it prints."""
    environment = {
        **os.environ,
        "PALPATE_HUB": str(tmp_path / "hub"),
        "PALPATE_CONTROL": str(tmp_path / "control"),
    }

    def run(line):
        program, *arguments = shlex.split(line)
        assert program == "palpate-host"
        done = subprocess.run(
            [*CLI, *arguments],
            env=environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def start_host(running, config):
    process = subprocess.Popen(
        [
            *CLI,
            "run",
            "--config",
            str(config),
            "--start",
            "command",
            "--socket",
            str(config.with_name("control")),
        ],
        stderr=subprocess.PIPE,
        text=True,
    )
    running.processes["host"] = process


def status_when(config, condition):
    """Return the host's first status that meets a condition."""
    end_s = time.monotonic() + PATIENCE_S
    status = None
    while time.monotonic() < end_s:
        try:
            with OperatorClient(config.with_name("control")) as client:
                status = client.ask(Status())
        except NoHostError:
            status = None
        if status is not None and condition(status):
            return status
        time.sleep(0.1)
    raise AssertionError(f"waited in vain: {status and (status.mode, status.reason)}")


def named_command(config, named):
    """Wait until the hand is in CHECK for this reason; return the command in it."""
    status = status_when(config, lambda status: named in status.reason)
    assert status.mode is Mode.CHECK
    return re.search(r"palpate-host [^,;]*", status.reason)[0]


def is_ready(status):
    return status.mode is Mode.READY


def test_a_stored_swapped_map_is_restored(running, config, run):
    for name, value in SWAP_X_AND_Y:
        run(f"palpate-host bus sdo write 0x10 {name} {value}")
    start_host(running, config)
    line = named_command(config, "1A00h:01 is 0x71300210, expected 0x71300110")
    assert "0 differences" in run(line)
    status_when(config, is_ready)


@pytest.mark.parametrize(
    "key", ["calibration", *(pytest.param(key, marks=pytest.mark.slow) for key in ("software", "serial"))]
)
def test_another_fingertip_is_accepted_by_name_and_written_into_hand_toml(running, config, run, key):
    """The next start waits for nothing."""
    before = config.read_text()
    config.write_text(
        before.replace("fingertip_node = 0x10", f"fingertip_node = 0x10\n{key} = {OTHERS[key]}")
    )
    start_host(running, config)
    named = {"calibration": "2001h:00 is ", "software": "100Ah:00 is ", "serial": "1018h:04 is "}[key]
    said = run(named_command(config, named))
    status_when(config, is_ready)
    first = hand_reader.load(config).fingers[0]
    found = getattr(first, key)
    assert found == FINGERTIP_HAS.get(key, found)
    assert said.startswith(f"finger-1: accepted {key} {found}, not {OTHERS[key].strip(chr(34))}.\n")
    assert f"{config}: fingers.{key} is written." in said
    assert [
        line for line in config.read_text().splitlines() if not line.startswith(f"{key} =")
    ] == before.splitlines()
    running.kill("host")
    start_host(running, config)
    status_when(config, is_ready)
