"""The blinking of a board's LED, on files as the kernel's LED class has them."""

from __future__ import annotations

import subprocess
import time

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
