"""The plug-in's robot and teleoperators as LeRobot makes them, without a twin (make lerobot-test)."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.integrations.conftest import Serving

from palpate_host.common import rotation
from palpate_host.common.command import Rotate
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus, matrix

pytestmark = pytest.mark.lerobot

PREAMBLE = """
import json, sys, time
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot.teleoperators import TeleoperatorConfig, make_teleoperator_from_config
from lerobot.utils.import_utils import register_third_party_plugins

register_third_party_plugins()
found = {}
"""
ROBOT = """
for path in sys.argv[1:]:
    robot = make_robot_from_config(RobotConfig.get_choice_class("palpate_hand")(control_socket=path))
    seen = found[path.rpartition("/")[2]] = {}
    try:
        seen["features"] = list(robot.observation_features)
        robot.connect()
        ask, seen["asked"] = robot._host.ask, []
        robot._host.ask = lambda command, **rest: (seen["asked"].append(command), ask(command, **rest))[1]
        seen["observation"] = list(robot.get_observation())
        seen["sent"] = robot.send_action(dict(zip(robot.action_features, (6.0, 0.0, 0.0))))
    except Exception as error:
        seen["error"] = [type(error).__name__, str(error)]
    seen["connected"] = robot.is_connected
"""
KEYS = """
from lerobot_robot_palpate.keys import KeyedOrientation

made = make_teleoperator_from_config(TeleoperatorConfig.get_choice_class("palpate_keys")())
found["made"] = [type(made).__name__, list(made.action_features)]
try:
    made.connect()
except Exception as error:
    found["unconnected"] = str(error)
keyed = KeyedOrientation(speed_deg_s=10.0, limit_deg=2.5)
found["held"] = [keyed.advance({"d", "w", "shift"}, 0.05) for _ in range(3)]
found["paused"] = keyed.advance({"e"}, 60.0)
found["limited"] = [keyed.advance({"q"}, 0.1) for _ in range(6)][-1]
found["back"] = [keyed.advance({"0"}, 0.1) for _ in range(4)][-1]
"""
GAMEPAD = """
import os, pathlib, tempfile

fifo = pathlib.Path(tempfile.mkdtemp()) / "js0"
os.mkfifo(fifo)
kind = TeleoperatorConfig.get_choice_class("palpate_gamepad")
config = kind(device=str(fifo), speed_deg_s=1e3, limit_deg=12.0)
gamepad = make_teleoperator_from_config(config)
gamepad.connect()
with fifo.open("wb", buffering=0) as device:
    device.write(bytes.fromhex("00000000ff7f0200" "00000000ff7f0201" "0000000001800203"))
    gamepad.get_action()
    time.sleep(0.05)
    found["sticks"] = [type(gamepad).__name__, gamepad.get_action()]
try:
    gamepad.get_action()
except Exception as error:
    found["unplugged"] = str(error)
gamepad.disconnect()
"""
TURNS = """
from lerobot_robot_palpate.turns import programme_deg

targets = [[10.0, -5.0, 0.0], [0.0, 0.0, 0.0]]
times_s = (0.0, 0.5, 1.0, 1.9, 2.5, 3.5, 4.25, 400.25)
found["turns"] = [programme_deg(targets, 10.0, 1.0, time_s) for time_s in times_s]
found["empty"] = [programme_deg(t, 10.0, 0.0, 5.0) for t in ([], [[0.0, 0.0, 0.0]])]
"""


@pytest.fixture(scope="module")
def hosts(tmp_path_factory: pytest.TempPathFactory, status: HostStatus) -> Iterator[dict[str, Serving]]:
    """Hosts that hold an object: one that obeys, one that refuses each command, one that was stopped."""
    folder = tmp_path_factory.mktemp("hosts")
    held = replace(status, R_d=matrix(rotation.from_rpy_deg(10.0, 20.0, -30.0)), turned=1.0)
    stopped = replace(held, mode=Mode.STOP, reason="the operator stopped the hand")
    with ExitStack() as stack:
        yield {
            name: stack.enter_context(closing(Serving(folder / name, state, refusal)))
            for name, state, refusal in (
                ("obeys", held, ""),
                ("refuses", held, "rotate is refused in mode release (opens): grasp first"),
                ("stopped", stopped, "grasp is refused in mode stop (stopped): recover first"),
            )
        }


@pytest.fixture(scope="module")
def found(lerobot: Callable[..., str], hosts: dict[str, Serving]) -> dict[str, Any]:
    """Results of the plug-in's devices, from one process of LeRobot's environment."""
    script = PREAMBLE + ROBOT + KEYS + GAMEPAD + TURNS + 'print("FOUND " + json.dumps(found))'
    output = lerobot("python", "-c", script, *(host.path for host in hosts.values()))
    line = output.splitlines()[-1]
    assert line.startswith("FOUND "), output
    values: dict[str, Any] = json.loads(line.removeprefix("FOUND "))
    return values


def test_an_action_is_a_turn_from_the_orientation_at_the_start(found, hosts) -> None:
    (turn,) = hosts["obeys"].commands
    seen = found["obeys"]
    assert "error" not in seen and seen["observation"] == seen["features"]
    assert isinstance(turn, Rotate) and turn.rpy_deg == pytest.approx((6.0, 0.0, 0.0), abs=1e-9)
    assert turn.ramp_s == pytest.approx(6.0 / 15.0)
    assert seen["sent"]["object.roll_deg"] == 6.0


def test_a_frame_waits_for_one_tick_at_most(found) -> None:
    """The host responds to a request once a tick; at 100 Hz a second one would cost 10 ms of each frame."""
    assert found["obeys"]["asked"] == ["rotate"]


def test_a_refused_action_is_an_error_with_the_hosts_reason(found) -> None:
    seen = found["refuses"]
    assert seen["error"] == ["PalpateHandError", "rotate is refused in mode release (opens): grasp first"]


def test_a_stopped_hand_is_not_moved(found, hosts) -> None:
    assert not hosts["stopped"].commands
    assert "recover first" in found["stopped"]["error"][1] and not found["stopped"]["connected"]


def test_held_keys_turn_at_the_speed_and_up_to_the_limit(found) -> None:
    assert found["made"] == ["PalpateKeys", [f"object.{name}_deg" for name in ("roll", "pitch", "yaw")]]
    assert np.array(found["held"]) == pytest.approx(np.outer([0.5, 1.0, 1.5], [1, 1, 0]))
    assert found["paused"] == pytest.approx([1.5, 1.5, -1.0])  # a pause counts as 0.1 s
    assert found["limited"] == pytest.approx([1.5, 1.5, 2.5])
    assert found["back"] == pytest.approx([0.0, 0.0, 0.0])


def test_without_a_display_the_keyboard_is_an_error_with_the_next_step(found) -> None:
    assert "needs an X11 session" in found["unconnected"] and "palpate_turns" in found["unconnected"]


def test_full_sticks_turn_to_the_limits_and_an_unplugged_gamepad_is_an_error(found) -> None:
    """Left stick right and towards the person, right stick left: roll +, pitch -, yaw +."""
    turned = {"object.roll_deg": 12.0, "object.pitch_deg": -12.0, "object.yaw_deg": 12.0}
    assert found["sticks"] == ["PalpateGamepad", turned]
    assert "is gone" in found["unplugged"]


def test_a_programme_of_turns_repeats(found) -> None:
    """1 s to 10 deg at 10 deg/s, 1 s of pause, the same back: 4 s a round."""
    rolls = [0.0, 5.0, 10.0, 10.0, 5.0, 0.0, 2.5, 2.5]
    assert np.array(found["turns"]) == pytest.approx(np.outer(rolls, [1.0, -0.5, 0.0]), abs=1e-9)
    assert found["empty"] == [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
