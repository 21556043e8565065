"""The units as systemd reads them: no key it does not know, and little that a service could do to a board."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import time
from pathlib import Path

import pytest

UNITS = Path(__file__).resolve().parents[2] / "systemd"
SERVICES = ("palpate-fingertip.service", "palpate-az.service", "palpate-host.service")
RESTARTED = SERVICES[:2]  # after each failure that may pass
SYSTEM = Path("/usr/lib/systemd/system")
MOST_EXPOSED = 1.5  # of 10


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """A file system with systemd's own units, ours, and the programs that they start."""
    if shutil.which("systemd-analyze") is None or not SYSTEM.is_dir():
        pytest.skip("systemd-analyze is missing: make system-deps")
    root = tmp_path_factory.mktemp("board")
    shutil.copytree(SYSTEM, root / SYSTEM.relative_to("/"), symlinks=True)
    shutil.copytree(UNITS, root / "etc/systemd/system")
    programs = root / "opt/palpate/current/bin"
    for program in (
        programs / "palpate-edge",
        programs / "palpate-host",
        root / "opt/palpate/bin/palpate-release",
        root / "usr/bin/sh",
    ):
        program.parent.mkdir(parents=True, exist_ok=True)
        program.write_text("#!/bin/sh\n")
        program.chmod(0o755)
    (root / "bin").symlink_to("usr/bin")
    return root


def analyze(*words, root):
    command = ["systemd-analyze", *words, f"--root={root}"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_verify_finds_nothing(board):
    answer = analyze("verify", *SERVICES, "palpate.target", "palpate-settle.service", root=board)
    ours = [line for line in answer.stderr.splitlines() if "palpate" in line]
    assert (answer.returncode, ours) == (0, [])


def test_verify_would_find_a_key_that_systemd_does_not_know(board, tmp_path):
    shutil.copytree(board, tmp_path / "board", symlinks=True)
    unit = tmp_path / "board/etc/systemd/system" / SERVICES[0]
    unit.write_text(unit.read_text().replace("WatchdogSec=", "WatchDogSecs="))
    assert "WatchDogSecs" in analyze("verify", SERVICES[0], root=tmp_path / "board").stderr


@pytest.mark.parametrize("service", SERVICES)
def test_exposure(board, service):
    answer = analyze("security", "--offline=yes", "--json=short", service, root=board)
    open_doors = [row for row in json.loads(answer.stdout) if row["exposure"]]
    overall = analyze("security", "--offline=yes", "--no-pager", service, root=board).stdout
    exposure = float(re.findall(r"Overall exposure level for \S+: ([\d.]+)", overall)[0])
    print(f"{service}: exposure {exposure}: " + ", ".join(row["name"] for row in open_doors))
    assert exposure <= MOST_EXPOSED


@pytest.mark.parametrize("service", SERVICES)
def test_what_the_service_is_held_to(service):
    """What the exposure does not tell: it says when it is ready, is watched, and has a bound on restarts."""
    text = (UNITS / service).read_text()
    for line in ("Type=notify", "NoNewPrivileges=yes", "DevicePolicy=closed", "PartOf=palpate.target"):
        assert f"\n{line}\n" in text
    assert re.search(r"^WatchdogSec=[12]s$", text, re.MULTILINE)
    assert re.search(r"^RestrictAddressFamilies=AF_UNIX AF_CAN$", text, re.MULTILINE)
    assert re.search(r"^StartLimitBurst=\d+$", text, re.MULTILINE)


def key(service, name):
    return re.findall(rf"^{name}=(.*)$", (UNITS / service).read_text(), re.MULTILINE)[0]


def test_statuses_that_are_not_tried_again_are_those_of_the_errors():
    from palpate_edge.common.errors import CalibrationError, ConfigError, DatasetError

    own_errors = {SERVICES[0]: (ConfigError, DatasetError, CalibrationError), SERVICES[1]: (ConfigError,)}
    for service, errors in own_errors.items():
        statuses = key(service, "RestartPreventExitStatus").split()
        assert [int(status) for status in statuses] == sorted(error.exit_status for error in errors)


def stop_post_s(service, status):
    """How long what runs after the end takes, as systemd runs it; it is the shell that waits, so roughly."""
    command = shlex.split(key(service, "ExecStopPost"))
    begin_s = time.monotonic()
    subprocess.run(command, env={"EXIT_STATUS": status, "PATH": os.defpath}, check=True)
    return time.monotonic() - begin_s


@pytest.mark.parametrize("service", RESTARTED)
def test_a_device_that_is_away_is_waited_for_and_a_crash_loop_ends(service):
    """systemd gives up what was started `burst` times within the interval (systemd.unit(5))."""
    from palpate_edge.common.errors import BusError, CaptureError

    assert (key(service, "RestartSec"), key(service, "StartLimitIntervalSec")) == ("200ms", "4min")
    restart_s, burst, interval_s = 0.2, int(key(service, "StartLimitBurst")), 240.0
    away = (CaptureError, BusError) if service == SERVICES[0] else (BusError,)
    for error in away:
        assert (restart_s + stop_post_s(service, str(error.exit_status))) * burst >= interval_s
    longest_life_s = interval_s / burst - restart_s
    assert longest_life_s >= 3.0
    for crash in ("1", "ABRT", "SEGV", "0"):
        assert stop_post_s(service, crash) < longest_life_s


def test_the_gateway_outlives_the_host_and_both_stop_with_the_target():
    assert key(SERVICES[1], "Before") == SERVICES[2]
    assert key(SERVICES[1], "PartOf") == key(SERVICES[2], "PartOf") == "palpate.target"


def test_serial_devices_are_the_gateways_alone():
    assert "char-tty" in (UNITS / SERVICES[1]).read_text()
    for service in (SERVICES[0], SERVICES[2]):
        text = (UNITS / service).read_text()
        assert "char-tty" not in text and "dialout" not in text
    assert key(SERVICES[2], "PrivateDevices") == "yes"


def test_sysusers_makes_the_user_of_the_units(tmp_path):
    if shutil.which("systemd-sysusers") is None:
        pytest.skip("systemd-sysusers is missing: make system-deps")
    (tmp_path / "etc").mkdir()
    (tmp_path / "usr/lib/sysusers.d").mkdir(parents=True)
    shutil.copy(UNITS / "sysusers.d/palpate.conf", tmp_path / "usr/lib/sysusers.d")
    subprocess.run(["systemd-sysusers", f"--root={tmp_path}"], check=True)
    assert re.search(r"^palpate:", (tmp_path / "etc/passwd").read_text(), re.MULTILINE)
    assert re.search(r"^i2c:", (tmp_path / "etc/group").read_text(), re.MULTILINE)
