"""Random handling of a held object under both laws."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_host.cli.main import cli
from palpate_host.config.control_config import ControlLaw, ControlMode
from palpate_host.config.twin_config import DisturbanceConfig
from palpate_twin.cli.options import PACKAGED
from palpate_twin.closed_loop.tactile_rendering import DomeContact, TrueContactSource
from palpate_twin.paper.random_chain import GappedContacts, run_trial_in_chain
from palpate_twin.paper.random_runs import LAWS, kind_of, random_table, run_all
from palpate_twin.paper.shake_random import (
    DELAY_S,
    FRICTION,
    GAP_S,
    RandomRun,
    RunKind,
    explanation,
    random_trial,
)
from palpate_twin.paper.trial import run_trial
from palpate_twin.paper.trial_parameters import Gap, Trial

HAND = PACKAGED["table4-wide"]
BASE = Trial(
    ControlMode.PROPOSED, (0.0, 0.0, 0.0), duration_s=5.0, noise_mm=0.25, force_noise=0.03, integral_per_s=1.0
)


def test_a_run_follows_from_its_number_and_stays_within_the_ranges():
    trials = [random_trial(BASE, number) for number in range(100)]
    assert trials == [random_trial(BASE, number) for number in range(100)]
    assert len({trial.rpy_deg for trial in trials}) == 100
    assert all(DELAY_S[0] <= trial.delay_s <= DELAY_S[1] for trial in trials)
    assert all(GAP_S[0] <= trial.gaps[0].duration_s <= GAP_S[1] for trial in trials)
    assert {trial.gaps[0].finger for trial in trials} == {0, 1, 2}
    frictions = [one.friction for trial in trials for one in trial.disturbances if one.friction is not None]
    assert len(frictions) == 200
    assert all(FRICTION[0] <= friction <= FRICTION[1] for friction in frictions)
    pushes = [one for trial in trials for one in trial.disturbances if np.isfinite(one.duration_s)]
    forces_N = np.linalg.norm([one.force_N for one in pushes], axis=1)
    assert 0.5 < forces_N.min() < 0.8
    assert 2.7 < forces_N.max() < 3.0


def test_an_explanation_names_what_acted():
    loads = (
        DisturbanceConfig(start_s=0.0, force_N=(0.0, 0.0, -2.0)),
        DisturbanceConfig(start_s=1.0, duration_s=0.2, force_N=(0.0, 1.5, 0.0)),
        DisturbanceConfig(start_s=0.5, friction=0.35),
    )
    trial = replace(BASE, disturbances=loads, friction=0.8, delay_s=0.15, gaps=(Gap(1, 1.05, 0.1),))
    assert explanation(trial, 0.2) == "slid from 0.20 s: load 2.0 N, friction 0.80, contacts 150 ms late"
    assert explanation(trial, 1.1) == (
        "slid from 1.10 s: load 2.5 N, friction 0.35, contacts 150 ms late, finger-2 without contacts"
    )


def test_a_row_counts_the_runs_of_a_law_and_a_line_explains_each_drop():
    runs = [
        RandomRun(ControlLaw.POSE, 0, None, 0.0, 1.0, 5.0, 0, ""),
        RandomRun(ControlLaw.POSE, 1, None, 2.0, 3.0, 9.5, 2, "slid from 1.00 s"),
        RandomRun(ControlLaw.PAPER, 0, 1.25, 12.0, 80.0, 4.0, 3, "slid from 1.10 s"),
    ]
    assert random_table(runs).splitlines()[2:] == [
        "| pose | 2 | 0 | 1 | 1.00 | 1.90 | 2.00 | 2.0 | 3.0 | 9.5 | 2 |",
        "| paper | 1 | 1 | 1 |  |  |  |  |  | 4.0 | 3 |",
        "",
        "- paper, run 0: dropped at 1.25 s; slid from 1.10 s",
    ]


def test_contacts_in_a_gap_are_lost_and_the_others_hold_the_object():
    """Half a second without contacts of one finger, in a turn of 10 deg: it ends where it ends without."""
    base = replace(BASE, law=ControlLaw.POSE, rpy_deg=(0.0, 10.0, 0.0), duration_s=2.5, noise_mm=0.0)
    whole, gapped = (
        run_trial(HAND, "mujoco", replace(base, gaps=gaps)) for gaps in ((), (Gap(0, 0.5, 0.5),))
    )
    assert gapped.lost_s is None
    assert gapped.error_deg < 0.5
    assert not np.array_equal(whole.rpy_deg, gapped.rpy_deg)


@pytest.mark.slow
def test_random_runs_drop_nothing_under_the_pose_law():
    """24 of the 200 runs of docs/holding.md; the paper's law drops some of them."""
    runs = run_all(HAND, BASE, LAWS, 24, 2)
    pose = [run for run in runs if run.law is ControlLaw.POSE]
    assert [run.number for run in pose if run.lost_s is not None] == []
    assert max(run.normal_N for run in pose) < 20.0  # limits.contact_force_N
    assert sum(run.lost_s is not None for run in runs if run.law is ControlLaw.PAPER) > 3


def test_the_command_writes_a_table_of_both_laws(tmp_path):
    words = f"simulate shake --random 1 --seconds 2.5 --jobs 1 -o {tmp_path}".split()
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    rows = (tmp_path / "results.md").read_text().splitlines()
    assert [row.split("|")[1].strip() for row in rows[2:4]] == ["pose", "paper"]


def test_one_run_of_three_in_the_chain_has_frames():
    kinds = [kind_of(number, in_chain=True, has_sensors=True) for number in range(6)]
    assert kinds == [RunKind.FRAMES, RunKind.CHAIN, RunKind.CHAIN] * 2
    assert {kind_of(number, in_chain=True, has_sensors=False) for number in range(6)} == {RunKind.CHAIN}
    assert kind_of(0, in_chain=False, has_sensors=False) is RunKind.LAW


def test_a_run_in_the_whole_chain_holds_the_object(tmp_path):
    words = f"simulate shake --random 1 --law pose --chain --seconds 2.5 --jobs 1 -o {tmp_path}".split()
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    row = (tmp_path / "results.md").read_text().splitlines()[2]
    assert [cell.strip() for cell in row.split("|")[1:4]] == ["pose, chain", "1", "0"]


def test_frames_in_a_gap_are_rejected():
    truth = DomeContact(np.array([0.0, 0.0, 29.0]), 2.0, np.zeros(3))
    contacts = GappedContacts(TrueContactSource(30.0, 0.0, 1), (Gap(1, 0.5, 0.1),), 1_000_000)
    found = [contacts.contact(1, truth, at_us, 0) for at_us in (1_499_999, 1_500_000, 1_599_999, 1_600_000)]
    assert [one.valid for one in found] == [True, False, False, True]
    assert contacts.contact(0, truth, 1_550_000, 0).valid


def test_an_object_that_is_lost_in_the_chain_is_dropped_with_the_reason():
    """A weight of 3 kg is too much for the largest grip."""
    heavy = DisturbanceConfig(start_s=0.2, force_N=(0.0, 0.0, -30.0))
    trial = replace(BASE, law=ControlLaw.POSE, disturbances=(heavy,), duration_s=1.5)
    run = run_trial_in_chain(HAND, trial, 7, None)
    assert run.lost_s == pytest.approx(0.4, abs=0.3)
    assert run.explanation.startswith("slid from 0.2")
    assert run.kind is RunKind.CHAIN
