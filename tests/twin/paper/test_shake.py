"""Pushes on a held object: the runs, their figures, the command."""

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_host.cli.main import cli
from palpate_host.config.hand_config import ControlMode
from palpate_twin.cli.options import PACKAGED
from palpate_twin.paper.shake import Held, directions, run_shake, shake_cases, shake_table
from palpate_twin.paper.trial import Trial

HAND = PACKAGED["table4-wide"]
BASE = Trial(ControlMode.PROPOSED, (0.0, 0.0, 0.0), duration_s=2.5, integral_per_s=1.0)


@pytest.mark.parametrize(("count", "lengths"), [(1, {1}), (6, {1}), (26, {1, 2, 3})])
def test_directions_are_distinct_unit_vectors(count, lengths):
    vectors = np.array(directions(count))
    assert len(np.unique(vectors.round(6), axis=0)) == count
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0)
    assert {int(np.count_nonzero(vector)) for vector in vectors} == lengths


def test_the_papers_law_keeps_the_orientation_and_not_the_place():
    """A push of 2 N for 0.2 s moves the object for good: nothing in Eqs. (9)-(16) brings it back."""
    push = next(case for case in shake_cases(BASE, 1) if case.name.startswith("push 2 N"))
    held = run_shake(HAND, push)
    assert held.lost_s is None
    assert held.error_deg < 0.1
    assert 25.0 < held.moved_later_mm < 35.0


def test_a_push_that_friction_cannot_hold_loses_the_object():
    push = next(case for case in shake_cases(BASE, 1) if case.name.startswith("push 5 N"))
    held = run_shake(HAND, push)
    assert 1.0 < held.lost_s < 2.0
    assert held.slip_mm > 10.0


def test_a_row_has_the_worst_of_its_directions():
    runs = [
        Held("push 1 N", 0.5, 2.0, 1.0, 0.9, 0.1, None),
        Held("push 1 N", 0.2, 3.0, 0.5, 0.4, 0.3, 1.5),
        Held("own weight", 0.0, 4.0, None, 4.0, 0.0, None),
    ]
    rows = shake_table(runs).splitlines()[2:]
    assert rows == [
        "| push 1 N | 0.50 | 3.0 | 1.0 | 0.9 | 0.30 | 1 of 2 |",
        "| own weight | 0.00 | 4.0 |  | 4.0 | 0.00 |  |",
    ]


@pytest.mark.long
def test_simulate_shake_writes_its_table(tmp_path):
    """Ten whole runs; with two processes as with one."""
    command = f"simulate shake --seconds 2.5 -o {tmp_path} --jobs"
    tables = []
    for jobs in ("1", "2"):
        result = CliRunner().invoke(cli, [*command.split(), jobs], catch_exceptions=False)
        assert result.exit_code == 0, result.output
        tables.append((tmp_path / "results.md").read_text())
    assert tables[0] == tables[1]
    names = [row.split("|")[1].strip() for row in tables[0].splitlines()[2:]]
    assert names[0] == "push 0.5 N for 0.2 s"
    assert names[-4:] == ["own weight", "roll 30 deg", "pitch 30 deg", "yaw 30 deg"]
