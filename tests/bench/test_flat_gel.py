"""The flat gel of docs/own-sensor.md: its field, and the page's steps to a calibrated sensor."""

from __future__ import annotations

import json
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from bench import flat_gel
from palpate_edge.cli.main import cli

PAGE = Path(__file__).parents[2] / "docs" / "own-sensor.md"
HALF_SPAN = (0.5, 3.0, 3.0, 1.0, 1.0, 10.0)


def test_dots_move_as_the_disc_does():
    gel = flat_gel.FlatGel(np.array([[3.0, 0.0], [0.0, -3.0], [9.0, 0.0], [-9.0, 0.0]]))
    still = gel.pressed_mm(np.zeros(6))
    np.testing.assert_array_equal(still, gel.rest_mm)
    shear = gel.pressed_mm(np.array([0, 0, 0, 1.0, 0, 0])) - gel.rest_mm
    np.testing.assert_allclose(shear[:2], [[0.6, 0.0]] * 2)  # below the disc: STICK of its way
    np.testing.assert_allclose(shear[2], [0.6 * 2 / np.pi * np.arcsin(2 / 3), 0.0])
    turn = gel.pressed_mm(np.array([0, 0, 0, 0, 0, 10.0])) - gel.rest_mm
    np.testing.assert_allclose(turn[0], [0.0, 0.6 * 3 * np.radians(10)])
    pressed = gel.pressed_mm(np.array([1.0, 0, 0, 0, 0, 0])) - gel.rest_mm
    np.testing.assert_allclose(pressed[2], -pressed[3], atol=1e-12)
    assert pressed[2, 0] > 0.1  # outwards
    tilted = gel.pressed_mm(np.array([1.0, 0, 3.0, 0, 0, 0])) - gel.rest_mm
    assert tilted[2, 0] > pressed[2, 0] > -tilted[3, 0] > 0  # deeper on the right


@pytest.mark.long
def test_the_steps_of_the_page_calibrate_a_sensor(tmp_path, monkeypatch):
    block = re.search(r"steps of the flat gel.*?```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert block is not None
    make, *steps = [shlex.split(line) for line in block[1].splitlines()]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["flat_gel", *make[3:], "--train", "80", "--test", "20"])
    assert make[:3] == ["python", "-m", "bench.flat_gel"]
    flat_gel.main()
    outputs = []
    for program, *arguments in steps:
        assert program == "palpate-edge"
        run = CliRunner().invoke(
            cli, arguments + (["--json", "gel.json"] if arguments[0] == "evaluate" else [])
        )
        assert run.exit_code == 0, run.output
        outputs.append(run.output)
    assert "140 beads (dark on grey" in outputs[0]
    assert "80 presses" in outputs[0]
    figures = json.loads((tmp_path / "gel.json").read_text())
    assert figures["refused"] == {}
    for label, half in zip(figures["labels"], HALF_SPAN, strict=True):
        assert label["mean_all"] < 0.2 * half / 2  # a fifth of a guess
    assert len((tmp_path / "poses.csv").read_text().splitlines()) == 101
