"""The fingertip's unit under a real systemd, with camera and CAN card: sandbox, watchdog, restarts."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from kernel_guest.links import receive
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame

pytestmark = pytest.mark.vm

UNITS = Path(__file__).resolve().parents[2] / "systemd"
SERVICE = "palpate-fingertip.service"
# An emulated processor needs ten times a board's time to start Python.
SLOW = "[Service]\nTimeoutStartSec=600s\nWatchdogSec=20s\nTimeoutStopSec=60s\n"


def systemctl(*words: str) -> str:
    return subprocess.run(["systemctl", *words], check=True, capture_output=True, text=True).stdout


def shown(name: str) -> str:
    return systemctl("show", "--value", f"--property={name}", SERVICE).strip()


@pytest.fixture
def board(can_cards, camera, vga_calibration):
    """Create users, folders, units and configuration as on a board; programs run from the sources."""
    etc = Path("/etc/systemd/system")
    for unit in (SERVICE, "palpate.target"):
        shutil.copy(UNITS / unit, etc)
    (etc / f"{SERVICE}.d").mkdir(exist_ok=True)
    (etc / f"{SERVICE}.d/slow.conf").write_text(SLOW)
    subprocess.run(["systemd-sysusers", UNITS / "sysusers.d/palpate.conf"], check=True)
    subprocess.run(["systemd-tmpfiles", "--create", UNITS / "tmpfiles.d/palpate.conf"], check=True)
    program = Path("/opt/palpate/current/bin/palpate-edge")
    program.parent.mkdir(parents=True, exist_ok=True)
    program.write_text(
        f"#!/bin/sh\nPYTHONPATH={os.environ['PYTHONPATH']}"
        f' exec {sys.executable} -m palpate_edge.cli.main "$@"\n'
    )
    program.chmod(0o755)
    calibration = Path("/etc/palpate/fingertip.cal")
    config = Path("/etc/palpate/fingertip.toml")
    shutil.copy(vga_calibration, calibration)
    config.write_text(
        f'name = "finger-1"\n[capture]\nsource = "v4l2"\npath = "{camera}"\ntimeout_ms = 5000\n'
        '[estimator]\ncalibration = "fingertip.cal"\n'
        '[node]\nid = 16\nparameters = "/var/lib/palpate/parameters"\n'
        '[bus]\ninterface = "socketcan"\nchannel = "can0"\n'
    )
    for file in (config, calibration):
        shutil.chown(file, "root", "palpate")
        file.chmod(0o640)
    systemctl("daemon-reload")
    yield can_cards[1]
    systemctl("stop", SERVICE)


@contextmanager
def host_on(link):
    with open_bus(BusConfig(interface="socketcan", channel=link.name), "host") as bus:
        yield bus


def wait_for_contacts(bus):
    """Start the node whenever it waits for that, until contacts are received.

    Contacts before its first heartbeat are of a process that hangs by now: they waited in the socket.
    """
    started = False
    while True:
        for frame in receive(bus, 1):
            if frame == CanFrame(0x710, b"\x7f"):
                bus.send([CanFrame(0x000, b"\x01\x10")])
                started = True
            if frame.can_id == 0x390 and started:
                return


def test_it_serves_inside_its_sandbox_and_a_hang_is_ended(board):
    with host_on(board) as host:
        systemctl("start", SERVICE)  # returns when the service has sent READY=1
        assert shown("ActiveState") == "active"
        wait_for_contacts(host)
        pid = int(shown("MainPID"))
        status = Path(f"/proc/{pid}/status").read_text()
        assert "\nCapEff:\t0000000000000000\n" in status
        assert "\nNoNewPrivs:\t1\n" in status
        assert "\nSeccomp:\t2\n" in status
        hung_at_s = time.monotonic()
        os.kill(pid, signal.SIGSTOP)
        wait_for_contacts(host)
        print(f"hang to contacts: {time.monotonic() - hung_at_s:.0f} s, 20 s of them the watchdog's")
        assert shown("NRestarts") == "1"
        assert int(shown("MainPID")) != pid
    systemctl("stop", SERVICE)
    assert shown("Result") == "success"


def test_a_configuration_that_cannot_work_is_not_tried_again(board):
    Path("/etc/palpate/fingertip.toml").write_text("nonsense")
    subprocess.run(["systemctl", "start", SERVICE], check=False, capture_output=True)
    assert (shown("ActiveState"), shown("Result"), shown("NRestarts")) == ("failed", "exit-code", "0")
    systemctl("reset-failed", SERVICE)
