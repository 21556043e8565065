"""The page of ``palpate-host console`` in a headless Chromium: buttons grasp and turn the twin's object."""

from __future__ import annotations

import math
from contextlib import closing

import numpy as np
import pytest
from tests.host.console_process import ConsoleProcess
from tests.host.hand_page import lead_to
from tests.twin_in_real_time import twin_in_real_time

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_twin.hand.motion import read_motion

ROLL_DEG, MOST_ERROR_DEG = 10.0, 1.5
HOLDING = ("grasp", "manipulate", "blind")


def about_x(angle_deg: float) -> Array:
    sin, cos = math.sin(math.radians(angle_deg)), math.cos(math.radians(angle_deg))
    return np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])


@pytest.mark.slow
def test_grasp_turn_and_stop_by_button(browser, tmp_path):
    """The turn is measured on the simulated object itself."""
    with (
        twin_in_real_time(tmp_path / "run", "--start", "command") as twin,
        closing(ConsoleProcess(twin.hand_toml, twin.control_socket, tmp_path / "recordings")) as console,
    ):
        browser.open(console.url)
        lead_to(browser, "[data-command=grasp]", "grasp")
        start = read_motion(twin.motion).rotations[-1]
        target = about_x(ROLL_DEG) @ start
        browser.run("document.querySelector('#roll').value = document.querySelector('#ramp').value = ''")
        browser.press_keys("#roll", str(ROLL_DEG))
        browser.press_keys("#ramp", "1")
        lead_to(browser, "#turn", "manipulate")

        def error_deg() -> float:
            return rotation.angle_deg(read_motion(twin.motion).rotations[-1] @ target.T)

        browser.until(lambda: error_deg() < MOST_ERROR_DEG, "not turned", "#mode", "#answer", "#state")
        assert browser.text("#mode") in HOLDING
        browser.click("#stop")
        browser.until(lambda: browser.text("#mode") == "stop", "no stop", "#mode", "#answer")
