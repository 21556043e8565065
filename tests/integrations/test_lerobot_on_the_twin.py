"""LeRobot's own recorder, loader, viewer, replay and teleoperation with the twin (make lerobot-test)."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.integrations.conftest import LEROBOT, real_time
from tests.integrations.joystick_events import INITIAL_STATE, LEFT_X, axis
from tests.integrations.lerobot_readers import load, view
from tests.integrations_page import commands
from tests.twin_in_real_time import PATIENCE_S

from palpate_edge.common.arrays import Array
from palpate_host import Hand
from palpate_host.common import rotation
from palpate_twin.demo.run_folder import RunFolder
from palpate_twin.hand.motion import read_motion

pytestmark = pytest.mark.lerobot

EPISODES, FPS, EPISODE_S = 3, 10, 8
TARGETS_DEG = [[12.0, 0.0, 0.0], [0.0, -8.0, 6.0]]
"""No way between them passes the start, so a replay that does nothing ends elsewhere."""
VIDEO = (
    "--dataset.streaming_encoding=true",
    "--dataset.encoder_threads=1",
    "--dataset.rgb_encoder.vcodec=h264",
    "--dataset.rgb_encoder.preset=ultrafast",
)
"""Options of LeRobot that take the least processor time, as docs/integrations.md gives them."""
LARGEST_ERROR_DEG, SMALLEST_TURN_DEG = 1.0, 5.0
SMALLEST_RATE = 0.9
"""Share of FPS, in the real-time class."""
TELEOPERATED_DEG = -8.0
"""Roll, back towards the start."""
SETTLED_DEG = 0.05
"""A true turn in a second below which the object rests."""


PRESS = """
import sys, time
from Xlib import X, XK, display
from Xlib.ext import xtest

screen = display.Display(sys.argv[1])
key = screen.keysym_to_keycode(XK.string_to_keysym(sys.argv[2]))
while True:
    xtest.fake_input(screen, X.KeyPress, key)
    screen.sync()
    time.sleep(0.2)
"""
"""Presses a key again and again as a keyboard that repeats."""


@contextmanager
def pressed_key(key: str) -> Iterator[str]:
    """Yield the name of an X display on which a key is held."""
    if shutil.which("Xvfb") is None:
        pytest.skip("xvfb is missing: make system-deps")
    server = ("Xvfb", "-displayfd", "1", "-screen", "0", "64x64x24", "-nolisten", "tcp")
    with ended(server, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as x_server:
        assert x_server.stdout is not None
        name = f":{x_server.stdout.readline().strip()}"
        with ended((str(LEROBOT / "python"), "-c", PRESS, name, key)) as person:
            yield name
            assert person.poll() is None


@contextmanager
def ended(command: tuple[str, ...], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Run a process until the end of the block."""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.terminate()


def robot(twin: RunFolder) -> list[str]:
    rings = {finger.name: str(twin.ring(finger.name)) for finger in twin.hand().fingers}
    return [
        "--robot.type=palpate_hand",
        f"--robot.control_socket={twin.control_socket}",
        "--robot.id=twin",
        "--robot.timeout_s=120",
        f"--robot.rings={json.dumps(rings)}",
    ]


@dataclass(frozen=True)
class Rest:
    """The object at rest: estimate, desired orientation and truth, each (3, 3)."""

    estimated: Array
    desired: Array
    true: Array


def rest(twin: RunFolder) -> Rest:
    """Wait until the turn has ended and the object rests, and return its orientation."""
    earlier: list[Array] = []
    with Hand(twin.control_socket) as hand:
        while True:
            status = hand.wait_for(lambda status: status.turned == 1.0, PATIENCE_S, "end its turn")
            true = read_motion(twin.motion).rotations[-1]
            earlier = [*earlier[-9:], true]
            if len(earlier) == 10 and rotation.angle_deg(true @ earlier[0].T) < SETTLED_DEG:
                return Rest(np.array(status.R_c), np.array(status.R_d), true)
            time.sleep(0.1)


@pytest.fixture(scope="module")
def start(twin: RunFolder) -> Rest:
    """The object as grasped, before LeRobot connects."""
    return rest(twin)


@pytest.fixture(scope="module")
def recorded(lerobot, twin: RunFolder, start: Rest, tmp_path_factory) -> tuple[Path, dict[str, Any]]:
    """Three episodes of LeRobot's recorder, and what its loader finds in them.

    The command is that of docs/integrations.md. Later options replace those of the page: other places, and a
    programme of turns in place of a person at the keys.
    """
    folder = tmp_path_factory.mktemp("recorded") / "set"
    program, *words = shlex.split(commands("Recording, replay and teleoperation")[-1])
    assert f"--dataset.num_episodes={EPISODES}" in words
    lerobot(
        program,
        *words,
        *robot(twin),
        "--teleop.type=palpate_turns",
        f"--teleop.targets_deg={TARGETS_DEG}",
        "--teleop.pause_s=3",
        "--dataset.repo_id=local/palpate",
        "--dataset.no_stamp=true",
        f"--dataset.root={folder}",
        f"--dataset.episode_time_s={EPISODE_S}",
        "--dataset.reset_time_s=0",
        f"--dataset.fps={FPS}",
        *VIDEO,
        "--dataset.push_to_hub=false",
        "--play_sounds=false",
    )
    return folder, load(lerobot, folder)


def test_the_recorder_writes_three_episodes_that_the_loader_reads(recorded, twin: RunFolder) -> None:
    _, found = recorded
    rate_fps = found["frames"] / EPISODES / EPISODE_S
    print(f"recorder: {rate_fps:.1f} frames/s of {FPS}")
    if real_time():
        assert rate_fps > SMALLEST_RATE * FPS
    assert found["episodes"] == EPISODES and found["robot_type"] == "palpate_hand"
    assert set(found["episode_index"]) == set(range(EPISODES))
    assert found["action_names"] == ["object.roll_deg", "object.pitch_deg", "object.yaw_deg"]
    names = found["state_names"]
    assert {f"{joint.name}.pos_rad" for joint in twin.hand().joints} <= set(names)
    state = np.array(found["state"])
    for finger in twin.hand().fingers:
        assert state[:, names.index(f"{finger.name}.in_contact")].mean() > 0.9
        assert state[:, names.index(f"{finger.name}.fn_N")].mean() > 0.5
    for shape, deviation in found["pictures"].values():
        assert shape[0] == 3 and deviation > 0.01
    assert len(found["pictures"]) == 3


def test_the_viewer_shows_what_was_recorded(lerobot, recorded, tmp_path: Path) -> None:
    """The last episode: state and action of every frame under their names, every camera's pictures."""
    folder, found = recorded
    names = {"observation.state": found["state_names"], "action": found["action_names"]}
    assert found["plotted_names"] == names
    viewed = view(lerobot, folder, EPISODES - 1, tmp_path)
    rows = np.array(found["episode_index"]) == EPISODES - 1
    assert np.array_equal(viewed.plots["state"], np.array(found["state"])[rows])
    assert np.array_equal(viewed.plots["action"], np.array(found["action"])[rows])
    assert viewed.pictures.keys() == found["pictures"].keys()
    for pictures in viewed.pictures.values():
        assert len(pictures) == rows.sum() and min(map(np.std, pictures)) > 1.0


def test_a_replayed_episode_ends_where_the_recorded_run_ended(
    lerobot, twin: RunFolder, start: Rest, recorded
) -> None:
    """The last episode, after the object was turned back: estimate and truth of the simulation."""
    folder, _ = recorded
    ended = rest(twin)
    assert rotation.angle_deg(ended.true @ start.true.T) > SMALLEST_TURN_DEG
    with Hand(twin.control_socket) as hand:
        back = rotation.to_rpy_deg(start.desired @ ended.desired.T)
        hand.rotate(back, ramp_s=2.0, timeout_s=PATIENCE_S)
    begun = rest(twin)
    lerobot(
        "lerobot-replay",
        *robot(twin),
        "--dataset.repo_id=local/palpate",
        f"--dataset.root={folder}",
        f"--dataset.episode={EPISODES - 1}",
        "--play_sounds=false",
    )
    replayed = rest(twin)
    assert rotation.angle_deg(replayed.true @ begun.true.T) > SMALLEST_TURN_DEG
    estimated_deg = rotation.angle_deg(replayed.estimated @ ended.estimated.T)
    true_deg = rotation.angle_deg(replayed.true @ ended.true.T)
    turned_deg = rotation.angle_deg(ended.true @ start.true.T)
    print(f"replay: {estimated_deg:.2f} deg off, {true_deg:.2f} in truth, after {turned_deg:.1f} deg")
    assert estimated_deg < LARGEST_ERROR_DEG
    assert true_deg < LARGEST_ERROR_DEG


def teleoperate(lerobot, twin: RunFolder, *options: str, **environment: str) -> tuple[Array, Array]:
    """Run LeRobot's teleoperation; return the turns of the desired and of the true object, deg."""
    before = rest(twin)
    time_s = f"--teleop_time_s={EPISODE_S}"
    lerobot("lerobot-teleoperate", *robot(twin), *options, time_s, f"--fps={FPS}", **environment)
    after = rest(twin)
    desired = rotation.to_rpy_deg(after.desired @ before.desired.T)
    return np.array(desired), np.array(rotation.to_rpy_deg(after.true @ before.true.T))


def test_teleoperation_turns_the_object_without_a_recording(lerobot, twin: RunFolder, recorded) -> None:
    """To the programme's target, where the host holds the object when LeRobot ends."""
    targets = f"--teleop.targets_deg={[[TELEOPERATED_DEG, 0.0, 0.0]]}"
    desired_deg, true_deg = teleoperate(
        lerobot, twin, "--teleop.type=palpate_turns", targets, "--teleop.pause_s=1000"
    )
    assert desired_deg == pytest.approx((TELEOPERATED_DEG, 0.0, 0.0), abs=0.05)
    assert true_deg[0] < -SMALLEST_TURN_DEG


def test_a_gamepads_stick_turns_the_object_to_the_limit(
    lerobot, twin: RunFolder, recorded, tmp_path: Path
) -> None:
    """The left stick is held to the right: the kernel's bytes in a FIFO that stays open."""
    device = tmp_path / "js0"
    os.mkfifo(device)
    with device.open("r+b", buffering=0) as kernel:
        kernel.write(INITIAL_STATE + axis(LEFT_X, 32767))
        options = (f"--teleop.device={device}", f"--teleop.limit_deg={-TELEOPERATED_DEG}")
        desired_deg, true_deg = teleoperate(lerobot, twin, "--teleop.type=palpate_gamepad", *options)
    assert desired_deg == pytest.approx((-TELEOPERATED_DEG, 0.0, 0.0), abs=0.05)
    assert true_deg[0] > SMALLEST_TURN_DEG


def test_a_held_key_turns_the_object_to_the_limit(lerobot, twin: RunFolder, recorded) -> None:
    """The key a on an X server without a screen."""
    with pressed_key("a") as display:
        limit = f"--teleop.limit_deg={-TELEOPERATED_DEG}"
        desired_deg, true_deg = teleoperate(
            lerobot, twin, "--teleop.type=palpate_keys", limit, DISPLAY=display
        )
    assert desired_deg == pytest.approx((TELEOPERATED_DEG, 0.0, 0.0), abs=0.05)
    assert true_deg[0] < -SMALLEST_TURN_DEG
