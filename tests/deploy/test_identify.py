"""The blinking of a board's LED, on files as the kernel's LED class has them. A fingertip's ring:
tests/firmware/test_identify.py."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from deploy_rig.image import ANSIBLE

pytestmark = pytest.mark.deploy_lint

SCRIPT = ANSIBLE / "files" / "identify.sh"


@pytest.fixture
def led(tmp_path):
    for name, value in (("trigger", "none timer [mmc0]"), ("brightness", "0"), ("max_brightness", "255")):
        (tmp_path / name).write_text(f"{value}\n")
    return tmp_path


def test_it_blinks_and_leaves_the_led_as_it_was(led):
    seen = set()
    with subprocess.Popen(["sh", SCRIPT, led, "1"]) as process:
        while process.poll() is None:
            seen.add(((led / "trigger").read_text().strip(), (led / "brightness").read_text().strip()))
            time.sleep(0.01)
    assert process.returncode == 0
    assert {("none", "255"), ("none", "0")} <= seen
    assert (led / "trigger").read_text() == "mmc0\n"


def test_a_board_without_that_led_is_told(tmp_path):
    answer = subprocess.run(
        ["sh", SCRIPT, tmp_path / "ACT", "1"], capture_output=True, text=True, check=False
    )
    assert answer.returncode == 1
    assert f"this board has no LED {tmp_path / 'ACT'}: give another one of" in answer.stderr


def test_a_fingertip_that_cannot_blink_says_why_before_its_boards_led_does(led):
    config = led / "finger.toml"
    config.write_text(
        'name = "finger"\n[capture]\nsource = "v4l2"\npath = "/dev/video0"\n[estimator]\n'
        'calibration = "finger.cal"\n[node]\nid = 16\n[bus]\ninterface = "socketcan"\nchannel = "can0"\n'
    )
    surroundings = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    command = ["sh", SCRIPT, led, "1", config]
    answer = subprocess.run(command, capture_output=True, text=True, check=False, env=surroundings)
    assert answer.returncode == 0
    assert "finger has no LED ring" in answer.stderr
    assert answer.stdout == f"the board's own LED {led} blinks\n"
