"""A hand without power, its motion as a file, its drawings, and the turns read back from a replay."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from palpate_edge.errors import DatasetError
from palpate_host import rotation
from palpate_host.demo.turn import step_bounds
from palpate_host.host import load_hand
from palpate_host.twin.hand.cli import PACKAGED
from palpate_host.twin.hand.experiment import make_engine
from palpate_host.twin.hand.film import draw_states, write_film
from palpate_host.twin.hand.motion import MotionFile, read_motion

TABLE_4 = PACKAGED["table4-wide"]
FACE_M = 0.040  # from the object's middle to its faces


@pytest.mark.parametrize("name", ["mujoco", "eqs"])
def test_braked_joints_stand_under_gravity_and_free_ones_fall(name):
    config, _ = load_hand(TABLE_4)
    engine = make_engine(config, name, has_B=False)
    start_rad = engine.q_rad.copy()
    braked = np.arange(9) != 2  # all but the first finger's last joint
    engine.brake(braked)
    for _ in range(400):
        engine.step(np.zeros(9))
    moved_rad = engine.q_rad - start_rad
    assert np.abs(moved_rad[braked]).max() < 1e-8
    assert moved_rad[2] > 0.02  # downwards closes
    engine.brake(np.ones(9, dtype=bool))
    held_rad = engine.q_rad.copy()
    for _ in range(400):
        engine.step(np.zeros(9))
    assert engine.q_rad == pytest.approx(held_rad, abs=1e-8)
    assert np.abs(engine.object_position_m).max() < 0.2  # nothing is flung away


def test_the_motion_file_gives_back_what_the_engine_had(tmp_path: Path):
    config, _ = load_hand(TABLE_4)
    engine = make_engine(config, "mujoco", has_B=False)
    seen = []
    with MotionFile(tmp_path / "motion.csv", [joint.name for joint in config.joints]) as file:
        for stamp_us in (1_700_000_000_000_000, 1_700_000_000_020_000):
            for _ in range(40):
                engine.step(np.full(9, 0.05))
            file.note(stamp_us, engine)
            seen.append((engine.q_rad.copy(), engine.object_rotation, engine.object_position_m))
    with (tmp_path / "motion.csv").open("a") as cut:
        cut.write("17000,0.1")  # the end of a killed process
    motion = read_motion(tmp_path / "motion.csv")
    assert motion.stamps_us.tolist() == [1_700_000_000_000_000, 1_700_000_000_020_000]
    for row, (q_rad, R, position_m) in enumerate(seen):
        assert motion.q_rad[row] == pytest.approx(q_rad, abs=1e-6)
        assert motion.rotations[row] == pytest.approx(R, abs=1e-6)
        assert motion.pose[row, :3] == pytest.approx(position_m, abs=1e-6)
    touches = [0.0 if touch is None else touch.normal_force_N for touch in engine.touches()]
    assert motion.force_N[1] == pytest.approx(touches, rel=1e-5)


def test_a_motion_that_is_missing_or_empty_is_refused(tmp_path: Path):
    with pytest.raises(DatasetError, match="run the demo again"):
        read_motion(tmp_path / "motion.csv")
    (tmp_path / "motion.csv").write_text("time_us\n")
    with pytest.raises(DatasetError, match="holds no motion"):
        read_motion(tmp_path / "motion.csv")


def test_the_plain_drawing_shows_the_object_where_opengl_would(tmp_path: Path):
    """The object moved to the side and back: its colour's middle moves and comes back."""
    config, _ = load_hand(TABLE_4)
    twin = make_engine(config, "eqs").twin
    states = [twin.start().qpos.copy() for _ in range(3)]
    states[1][twin.object_q + 2] += 0.05
    pictures = draw_states(twin, states, (240, 320), plainly=True)
    rows = []
    for picture in pictures:
        blue, green, red = (picture[..., channel].astype(int) for channel in range(3))
        is_object = (red > green + 20) & (green > blue + 20)  # MuJoCo's own mesh is (0.85, 0.65, 0.3)
        assert is_object.sum() > 500
        rows.append(np.flatnonzero(is_object.any(axis=1)).mean())
    assert rows[1] < rows[0] - 10  # higher in the picture
    assert rows[2] == rows[0]
    write_film(tmp_path / "hand.webp", pictures, 100)
    assert (tmp_path / "hand.webp").read_bytes()[8:12] == b"WEBP"


def test_the_plain_camera_is_mujocos():
    """MuJoCo's free camera, asked for its place and direction through its own scene."""
    from palpate_host.twin.hand.plain_drawing import _View

    twin = make_engine(load_hand(TABLE_4)[0], "eqs").twin
    camera = mujoco.MjvCamera()
    camera.lookat = np.array([0.01, -0.02, 0.1])
    camera.distance, camera.azimuth, camera.elevation = 0.5, 60.0, -35.0
    scene, data = mujoco.MjvScene(twin.model, maxgeom=100), twin.start()
    mujoco.mjv_updateScene(
        twin.model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene
    )
    place = (np.array(scene.camera[0].pos) + np.array(scene.camera[1].pos)) / 2  # of both eyes
    view = _View(camera, (240, 320))
    assert view.place == pytest.approx(place, abs=1e-6)
    assert view.pixel(np.array(camera.lookat)) == (160, 120)


def test_turns_are_told_apart_by_their_rests():
    ramp = [np.array([0.0, 0.0, a]) for a in (0.0, 0.1, 0.2, 0.2, 0.2, 0.1, 0.0, 0.0)]
    target = np.array([rotation.exp(vector) for vector in ramp])
    assert step_bounds(target) == [(0, 4), (4, 7)]
    assert step_bounds(target[:1]) == []
