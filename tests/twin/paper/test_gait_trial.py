"""Large turns by finger gaiting on the twin: the phases, the stops, the figures, the command."""

import math

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_host.cli.main import cli
from palpate_host.common import rotation
from palpate_host.common.command import CommandError
from palpate_host.common.gait_plan import GaitPlan, Regrasp, TurnTo
from palpate_host.config.control_config import ControlMode
from palpate_host.control.gait.gait import LOST_FRAMES, GaitPhase
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.paper.gait_runs import GaitCase, gait_table, run_case
from palpate_twin.paper.gait_trial import GaitOutcome, GaitRun
from palpate_twin.paper.trial import trial_setup
from palpate_twin.paper.trial_parameters import Trial

HAND = PACKAGED["table4-four"]
TRIAL = Trial(ControlMode.PROPOSED, (0.0, 0.0, 0.0), noise_mm=0.15, force_noise=0.03, has_weight=True)
NORMALS = np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
ONES = np.ones(4)
Z = np.array([0.0, 0.0, 1.0])


def held():
    """The hand of four fingers, one second after the start: it holds the object."""
    config, hand = load_hand(HAND)
    config, engine = trial_setup(config, "mujoco", TRIAL)
    run = GaitRun(config, hand, engine, TRIAL)
    run.run_until(1.0)
    return run, engine


def small_turn(law):
    normals = NORMALS @ law.object.R  # the object stands as the hand: its faces look along the axes
    return GaitPlan(Z, math.radians(2.0), normals, (TurnTo(math.radians(2.0), ONES, 0.0),))


@pytest.mark.slow
def test_a_turn_without_regrasp_ends_where_it_should():
    run, engine = held()
    before = engine.object_rotation
    run.control.start_gait(small_turn(run.control.pose_law))
    with pytest.raises(CommandError, match="another one is under way"):
        run.control.start_gait(small_turn(run.control.pose_law))
    with pytest.raises(CommandError, match="finger gaiting is under way"):
        run.control.turn((0.0, 0.0, 1.0), 1.0)
    run.run_until(4.0)
    assert run.control.gait.phase is GaitPhase.DONE
    turned = rotation.log(engine.object_rotation @ before.T)
    np.testing.assert_allclose(np.degrees(turned), [0.0, 0.0, 2.0], atol=0.4)


def test_a_holding_finger_without_contact_stops_the_gait():
    run, _ = held()
    run.control.start_gait(small_turn(run.control.pose_law))
    for _ in range(LOST_FRAMES):
        run.control.gait.note_contact(2, in_contact=False)
    run.run_until(1.1)
    assert run.control.gait.phase is GaitPhase.STOPPED
    assert run.control.gait.reason == "gait stopped: finger 3 lost the object"


def test_a_gait_needs_a_held_object():
    config, hand = load_hand(HAND)
    config, engine = trial_setup(config, "mujoco", TRIAL)
    run = GaitRun(config, hand, engine, TRIAL)
    with pytest.raises(CommandError, match="a held object"):
        run.control.start_gait(GaitPlan(Z, 1.0, NORMALS, ()))


def regrasp_of(law, point_m):
    """Finger 2 lifts by 8 mm and takes hold again at a point of its face."""
    share = np.array([1.0, 0.0, 1.0, 0.45])
    normal = law.object.R.T @ NORMALS[1]
    step = Regrasp(1, normal, law.object.R.T @ np.array(point_m), 0.008, share, ONES, 0.0)
    return GaitPlan(Z, 0.0, NORMALS @ law.object.R, (step,))


@pytest.mark.slow
def test_a_finger_lifts_and_takes_hold_again_while_three_hold():
    run, engine = held()
    law = run.control.pose_law
    law.follow_point(engine.object_position_m)
    run.control.start_gait(regrasp_of(law, (0.005, 0.04, 0.0)))
    start_m, start_R, seen, lifted_N = engine.object_position_m, engine.object_rotation, [], 0.0
    while not run.control.gait.is_over:
        run.run_until(run.time_s + 0.01)
        phase = run.control.gait.phase
        seen += [phase] if phase not in seen else []
        contact = engine.tip_contacts()[1]
        if phase is GaitPhase.CARRY and contact is not None:
            lifted_N = max(lifted_N, contact.normal_force_N)
    kinds = ("UNLOAD", "LIFT", "CARRY", "APPROACH", "LOAD", "DONE")
    assert seen == [GaitPhase[kind] for kind in kinds]
    assert lifted_N == 0.0
    assert engine.tip_contacts()[1].point_m[0] - start_m[0] == pytest.approx(0.005, abs=0.0015)
    assert np.linalg.norm(engine.object_position_m - start_m) < 1e-3
    assert rotation.angle_deg(engine.object_rotation @ start_R.T) < 0.5


@pytest.mark.slow
def test_a_finger_that_finds_no_object_stops_the_gait():
    run, engine = held()
    law = run.control.pose_law
    law.follow_point(engine.object_position_m)
    run.control.start_gait(regrasp_of(law, (0.0, 0.052, 0.0)))  # 12 mm before the face
    while not run.control.gait.is_over:
        run.run_until(run.time_s + 0.05)
    assert run.control.gait.reason == "gait stopped: finger 2 found no object where it should take hold"
    run.run_until(run.time_s + 0.5)
    assert sum(one is not None for one in engine.tip_contacts()) == 3
    assert run.control.pose_law.moved_mm < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("axis", [0, 2])
def test_a_quarter_turn_by_gaiting_stays_within_2_deg_and_2_mm(axis):
    outcome = run_case(HAND, GaitCase(axis, 90.0, TRIAL))
    assert isinstance(outcome, GaitOutcome)
    assert outcome.problem == ""
    assert not outcome.is_dropped
    assert outcome.regrasped == outcome.plan.regrasps >= 4
    assert outcome.error_deg < 2.0
    assert outcome.moved_mm < 2.0
    assert outcome.moved_most_mm < 3.0
    assert outcome.normal_N < 10.0


def test_the_table_has_the_worst_of_each_turn_and_a_line_for_each_failure():
    plan = GaitPlan(Z, 1.0, NORMALS, (TurnTo(1.0, ONES, 0.25),))
    good = GaitOutcome(plan, 4, 0.1, 0.2, 1.5, 0.7, 3.0, 20.0)
    bad = GaitOutcome(
        plan, 2, 40.0, 60.0, 60.0, 9.0, 8.0, 7.0, "gait stopped: finger 1 lost the object", True
    )
    cases = [GaitCase(0, 90.0, TRIAL), GaitCase(0, 90.0, TRIAL), GaitCase(2, 90.0, TRIAL)]
    lines = gait_table(cases, [good, bad, "the turn is refused: why"]).splitlines()
    assert lines[2] == "| roll 90 deg | 2 | 1 | 0 | 0 | 4 | 0.25 | 40.00 | 60.00 | 60.0 | 9.0 | 8.0 | 20 |"
    assert lines[3] == "| yaw 90 deg | 1 | 0 | 0 | 1 |  |  |  |  |  |  |  |  |"
    assert lines[5:] == [
        "- roll 90 deg, seed 1: gait stopped: finger 1 lost the object",
        "- yaw 90 deg, seed 1: the turn is refused: why",
    ]


@pytest.mark.slow
def test_the_command_prints_and_keeps_the_table(tmp_path):
    arguments = ["simulate", "gait", "--axis", "yaw", "--angle", "15", "--jobs", "1", "-o", str(tmp_path)]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 0, result.output
    assert "| yaw 15 deg | 1 | 0 | 0 | 0 | 0 |" in result.output
    assert "| yaw 15 deg |" in (tmp_path / "results.md").read_text()
