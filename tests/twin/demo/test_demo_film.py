"""The film of a run: its length is limited, and the report of a run does not depend on it."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.common.errors import DatasetError
from palpate_host.service.host import load_hand
from palpate_twin.cli.film import film
from palpate_twin.demo.film import film_command, make_film
from palpate_twin.demo.run_folder import MODEL, RunFolder
from palpate_twin.hand.motion import PERIOD_US, MotionFile, film_cut, read_motion
from palpate_twin.paper.trial import make_engine

ROW_S = PERIOD_US / 1e6


def write_motion(path: Path, seconds: float, still_s: float = 0.0) -> None:
    """Write a motion in which the packaged hand's first joint moves at 0.1 rad/s from `still_s` on."""
    config, _ = load_hand(MODEL)
    engine = make_engine(config, "eqs")
    at = engine.twin.q_address[0]
    with MotionFile(path, [joint.name for joint in config.joints], len(config.fingers)) as file:
        for row in range(round(seconds / ROW_S) + 1):
            engine.data.qpos[at] += 0.1 * ROW_S * (row * ROW_S > still_s)
            file.write(1_700_000_000_000_000 + row * PERIOD_US, engine)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunFolder:
    """Return the folder of a run that moved for 3 s."""
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    folder = RunFolder(tmp_path)
    folder.truth.mkdir()
    shutil.copy(MODEL, folder.hand_toml)
    write_motion(folder.motion, 3.0)
    return folder


@pytest.mark.parametrize(("longest_s", "pictures"), [(60.0, 85), (8.0, 80), (2.0, 20), (1.0, 10)])
def test_a_longer_motion_is_shown_from_its_beginning(tmp_path, longest_s, pictures):
    """Still for 2 s of 10: the film begins half a second before the hand moves, and has 8.5 s to show."""
    write_motion(tmp_path / "motion.csv", 10.0, still_s=2.0)
    motion = read_motion(tmp_path / "motion.csv")
    cut = film_cut(motion, 10.0, longest_s)
    assert cut.whole_s == pytest.approx(8.5, abs=2 * ROW_S)
    assert len(cut.rows) == pytest.approx(pictures, abs=1)
    shown_s = (motion.stamps_us[cut.rows] - motion.stamps_us[0]) / 1e6
    assert shown_s[0] == pytest.approx(1.5, abs=2 * ROW_S)
    assert np.diff(shown_s) == pytest.approx(0.1, abs=ROW_S)


@pytest.mark.parametrize(
    ("options", "pictures", "message"),
    [
        ([], 30, "30 pictures, drawn by the plain renderer"),
        (["--longest", "1"], 10, "first 1 of 3.0 s, drawn by the plain renderer"),
    ],
)
def test_the_command_reports_what_it_leaves_out(folder, options, pictures, message):
    paths = ["--config", str(folder.hand_toml), "--motion", str(folder.motion), "-o", str(folder.film)]
    done = CliRunner().invoke(film, [*paths, "--plain", *options])
    assert message in done.output
    read, animation = cv2.imreadanimation(str(folder.film))
    assert read
    assert sum(animation.durations) == 100 * pictures  # pictures that are alike are one that stays


def test_the_demo_tells_how_its_film_was_drawn(folder):
    made = make_film(folder)
    assert made.is_there
    assert made.description.startswith("30 pictures, drawn ")
    assert folder.film.read_bytes()[8:12] == b"WEBP"
    assert folder.film.with_suffix(".png").is_file()


def test_a_film_that_takes_too_long_is_none_and_its_command_makes_it(folder):
    folder.film.write_bytes(b"of an earlier run")
    made = make_film(folder, timeout_s=0.2)  # a Python alone takes longer
    assert not made.is_there
    assert not folder.film.exists()
    why, _, command = made.description.partition("; to draw it: palpate-host simulate film ")
    assert why == "the film was not drawn within 0.2 s"
    done = CliRunner().invoke(film, [*shlex.split(command), "--plain"])
    assert done.exit_code == 0, done.output
    assert folder.film.read_bytes()[8:12] == b"WEBP"


def test_a_film_that_cannot_be_drawn_is_none_and_says_why(folder):
    folder.motion.unlink()
    with pytest.raises(DatasetError) as expected:
        read_motion(folder.motion)
    made = make_film(folder)
    assert not made.is_there
    assert f"the film could not be drawn: error: {expected.value}" in made.description
    assert made.description.endswith(film_command(folder))
