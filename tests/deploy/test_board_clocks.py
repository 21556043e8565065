"""The clocks of a hand's boards without a network but their own: the host serves its time, the boards follow.

Three guests of user-mode Linux with crystals of different errors and a wrong time at the start run Debian's
chrony with the files of site.yml. Their clocks are compared by an exchange of time stamps, not by chrony.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from deploy_rig.clock_guests import HOST_ADDRESS, ClockGuest, clock_guests
from deploy_rig.image import ANSIBLE, ansible
from kernel_guest.user_mode import UserModeLinux

pytestmark = pytest.mark.slow

FREE_S, CONVERGED_S, LASTS_S = 25.0, 60.0, 150.0  # without chrony, until the clocks must agree, altogether
BOOT_S = 300.0  # on a busy machine
MEASUREMENTS = 3  # at most: another one where the computer let a guest stand still, as no board does
MOST_APART_S = 1e-3
MOST_ERROR_S = 0.25e-3  # an exchange that was delayed more is left out
HOST = ("2020-01-01 00:00:00", -20.0)  # no board has a battery; crystals are within 50 ppm
FINGERTIPS = {"finger-1": ("2019-06-01 00:00:00", 35.0), "finger-2": ("2020-01-01 00:00:01", -50.0)}


@pytest.fixture(scope="module")
def chrony_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return what site.yml writes to /etc/chrony/conf.d of a host and its fingertips, from its template."""
    folder = tmp_path_factory.mktemp("chrony")
    hosts = {"hand": {"ansible_host": HOST_ADDRESS}}
    inventory = {"hands": {"hosts": hosts}, "fingertips": {"hosts": {name: {} for name in FINGERTIPS}}}
    (folder / "inventory.json").write_text(json.dumps(inventory))
    template = ANSIBLE / "roles/base/templates/chrony.conf"
    command = [ansible("ansible"), "all", "-i", folder / "inventory.json", "-c", "local"]
    command += ["-e", f"@{ANSIBLE}/roles/base/defaults/main.yml"]
    command += ["-e", f"ansible_python_interpreter={ansible('python')}", "-m", "ansible.builtin.template"]
    command += ["-a", f"src={template} dest={folder}/{{{{ inventory_hostname }}}}.conf"]
    environment = {**os.environ, "ANSIBLE_LOCAL_TEMP": str(folder), "ANSIBLE_REMOTE_TEMP": str(folder)}
    answer = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert answer.returncode == 0, answer.stdout + answer.stderr
    return {path.stem: path.read_text() for path in folder.glob("*.conf")}


@pytest.fixture(scope="module")
def offsets(
    chrony_files: dict[str, str], packaged_card: tuple[Path, ...], tmp_path_factory: pytest.TempPathFactory
) -> tuple[float, dict[str, list[dict[str, float]]]]:
    """Return the time of chrony's start on the boards, and the offsets of each board to the host."""
    if (reason := UserModeLinux().missing()) is not None:
        pytest.skip(reason)
    if shutil.which("cc") is None:
        pytest.skip("gcc is missing: make system-deps")
    host = ClockGuest("host", chrony_files["hand"], HOST[1], HOST[0])
    boards = [ClockGuest(name, chrony_files[name], ppm, at) for name, (at, ppm) in FINGERTIPS.items()]
    for _ in range(MEASUREMENTS):
        folder = tmp_path_factory.mktemp("clocks")
        with clock_guests(folder, packaged_card, host, boards, LASTS_S) as guests:
            end_s = time.monotonic() + BOOT_S
            while not all(exact(guests.offsets(name)[-1:], FREE_S) for name in FINGERTIPS):
                assert time.monotonic() < end_s, "no exchange"
                time.sleep(0.5)
            started_s = max(guests.offsets(name)[-1]["at_s"] for name in FINGERTIPS)
            guests.start_chrony()
            still_s = guests.wait(LASTS_S + BOOT_S)
            rows = {name: guests.offsets(name) for name in FINGERTIPS}
        if not still_s:
            break
        print(f"a guest stood still for {still_s:.1f} s")
    return started_s, rows


def exact(rows: list[dict[str, float]], begin_s: float, end_s: float = math.inf) -> list[dict[str, float]]:
    """Return the rows of this time that are exact enough."""
    return [row for row in rows if begin_s <= row["at_s"] <= end_s and row["error_s"] <= MOST_ERROR_S]


@pytest.mark.parametrize("name", FINGERTIPS)
def test_the_clocks_differ_by_their_crystals_without_chrony(offsets: Any, name: str) -> None:
    started_s, rows = offsets
    free = exact(rows[name], 0.0, started_s)
    lasted_s = free[-1]["at_s"] - free[0]["at_s"]
    drift = (free[-1]["offset_s"] - free[0]["offset_s"]) / lasted_s
    error = (free[-1]["error_s"] + free[0]["error_s"]) / lasted_s
    print(f"{name}: {free[0]['offset_s']:.3f} s from the host, drift {drift * 1e6:.1f} ppm")
    assert abs(free[0]["offset_s"]) > 0.5
    assert drift == pytest.approx((FINGERTIPS[name][1] - HOST[1]) * 1e-6, abs=error)


def test_boards_without_network_agree_within_a_millisecond(offsets: Any) -> None:
    started_s, rows = offsets
    apart_s = []
    for name in FINGERTIPS:
        late = exact(rows[name], started_s + CONVERGED_S)
        assert len(late) >= 10, f"{len(late)} exchanges are exact enough"
        outside = [row["at_s"] - started_s for row in rows[name] if abs(row["offset_s"]) > MOST_APART_S]
        apart_s.append(max(abs(row["offset_s"]) + row["error_s"] for row in late))
        print(
            f"{name}: at most {apart_s[-1] * 1e3:.3f} ms from the host in {len(late)} exchanges, half of the "
            f"way included; within 1 ms {max(outside):.0f} s after the start of chrony"
        )
    print(f"two fingertips: at most {sum(apart_s) * 1e3:.3f} ms apart")
    assert sum(apart_s) <= MOST_APART_S
