"""Recorded runs under the pose law, with finger gaiting, and of drive nodes with several axes on CAN FD: the
log gives what the host did, and a replay repeats it."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import replace

import pytest
from click.testing import CliRunner
from tests.host.axes_hand import axes_text
from tests.host.recorded_run import WIDE, Run, check_export, record, replay
from tests.host.view.test_view import read

from palpate_host.cli.main import cli
from palpate_host.common.command import Command, Grasp, Move, Reorient, Rotate
from palpate_host.common.mode import Mode
from palpate_host.common.tick_inputs import Planned
from palpate_host.config.packaged import MODELS
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.recorded_replay import ReplayDifferenceError
from palpate_twin.closed_loop.lockstep import LockstepLoop

pytestmark = pytest.mark.long

Operate = Callable[[LockstepLoop], int]
HELD_S, SETTLED_S = 2.0, 0.3
AT_REST = "rpy_deg = [0.0, 0.0, 0.0]\nramp_s = 0.5"
GAIT_DEG, LONGEST_GAIT_S = 45.0, 60


def pose_hand() -> tuple[str, bool, Operate]:
    """Return hand.toml's text, whether the object has weight, and what operates the hand."""
    text = at_rest(WIDE.read_text().replace("[control]", '[control]\nlaw = "pose"', 1))
    commands = (
        Move((1.0, -0.5, 1.5), (0.0, 0.0, 4.0), 0.4),
        Rotate((3.0, 0.0, 0.0), 0.3),
        Grasp(),
        Move((-1.0, 0.5, -1.5), (1.0, 2.0, -4.0), 0.4),
    )
    return text, False, lambda loop: commanded(loop, *commands)


def gaiting_hand() -> tuple[str, bool, Operate]:
    def operate(loop: LockstepLoop) -> int:
        loop.run(HELD_S)
        engine = loop.engine
        corners_m = engine.twin.prism.vertices_m @ engine.object_rotation.T + engine.object_position_m
        corners_mm = tuple(map(tuple, (1e3 * corners_m).round(2).tolist()))
        loop.host.command(Reorient((0.0, 0.0, GAIT_DEG), corners_mm))
        for _ in range(LONGEST_GAIT_S):
            loop.run(1.0)
            if loop.status.hold.gait == "done":
                break
        assert loop.status.hold.gait == "done", loop.status.hold
        return 1 + commanded(loop, Move((0.0, 0.0, 1.0), ramp_s=0.3))

    return at_rest((MODELS / "table4-four.toml").read_text()), True, operate


def axes_hand() -> tuple[str, bool, Operate]:
    text = axes_text((MODELS / "table4.toml").read_text())
    return text, False, lambda loop: commanded(loop, Rotate((3.0, 0.0, 0.0), 0.3))


def at_rest(text: str) -> str:
    """Return the hand.toml of a hand that holds its object until it is commanded."""
    changed, count = re.subn(r"(\[target\]\n)rpy_deg = .*\nramp_s = .*", rf"\1{AT_REST}", text)
    assert count == 1
    return changed


def commanded(loop: LockstepLoop, *commands: Command) -> int:
    """Execute the commands one after the other; return their number."""
    loop.run(HELD_S)
    for command in commands:
        loop.host.command(command)
        loop.run((getattr(command, "ramp_s", None) or 0.0) + SETTLED_S)
        assert loop.status is not None and loop.status.mode in (Mode.MANIPULATE, Mode.GRASP)
    return len(commands)


HANDS = {"pose": pose_hand, "gait": gaiting_hand, "axes": axes_hand}


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("axes", "gait")]


@pytest.fixture(scope="module", params=["pose", *SLOW])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    text, has_weight, operate = HANDS[request.param]()
    return record(tmp_path_factory.mktemp(request.param), text, 1, operate, has_weight=has_weight)


def test_the_export_is_what_was_recorded(run: Run, tmp_path) -> None:
    check_export(run, tmp_path / "run.csv")


def test_an_mcap_of_the_log_gives_the_same_table(run: Run, tmp_path) -> None:
    for source, output in ((run.log, "log.csv"), (run.log, "run.mcap"), (tmp_path / "run.mcap", "mcap.csv")):
        arguments = ["export", str(source), "--config", str(run.hand_toml), "-o", str(tmp_path / output)]
        done = CliRunner().invoke(cli, arguments)
        assert done.exit_code == 0, done.stderr
    assert (tmp_path / "mcap.csv").read_bytes() == (tmp_path / "log.csv").read_bytes()


def test_statuses_of_the_log_are_the_hosts_own(run: Run) -> None:
    """Except that the host's own command is not rounded to thousandths."""
    found = list(read_statuses(run.log, run.config, run.hand))
    assert [replace(one, joints=()) for one in found] == [replace(one, joints=()) for one in run.statuses]
    for ours, theirs in zip(found, run.statuses, strict=True):
        own_Nm = [joint.command_Nm for joint in theirs.joints]
        joints = zip(ours.joints, own_Nm, strict=True)
        assert tuple(replace(joint, command_Nm=command_Nm) for joint, command_Nm in joints) == theirs.joints


def test_a_replay_repeats_the_run_with_its_commands(run: Run) -> None:
    done = replay(run)
    assert done.exit_code == 0, done.output
    assert f"{len(run.statuses)} ticks: every frame of the host is as recorded" in done.stdout


def test_every_missing_command_and_plan_is_named(run: Run, tmp_path) -> None:
    """A turn by gaiting has two records: its command and its plan."""
    lines = run.log.read_text().splitlines(keepends=True)
    places = [i for i, line in enumerate(lines) if line.startswith("#! ") and " input " in line]
    plans = [
        given for status in run.statuses for given in status.inputs.events if isinstance(given.event, Planned)
    ]
    assert len(places) == run.commands + len(plans) + 1  # the last ends the run
    for place in places:
        end = next(i for i in range(place + 1, len(lines)) if not lines[i].startswith("#+"))
        log = tmp_path / "without.log"
        log.write_text("".join(lines[:place] + lines[end:]))
        error = replay(run, log).exception
        assert isinstance(error, ReplayDifferenceError)
        assert "1 of the host's commands or other events are missing before the tick at" in str(error)


def test_the_viewer_shows_the_modes_of_the_run(run: Run, tmp_path) -> None:
    arguments = ["view", str(run.log), "--config", str(run.hand_toml), "--save", str(tmp_path / "run.rrd")]
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 0, done.output
    shown = [value[0] for _, value in read(tmp_path / "run.rrd")["/log"]["TextLog:text"]]
    modes = [mode for mode, _ in itertools.groupby(status.mode.value for status in run.statuses)]
    assert [mode for mode, _ in itertools.groupby(text.split(":")[0] for text in shown)] == modes
