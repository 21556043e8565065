"""The guide with a printed jig: hole by hole, pictures of the twin's rod, from the start to the file."""

from __future__ import annotations

import pytest
from click.testing import CliRunner
from tests.edge.guide.test_guide import Person

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.cli.jig import jig
from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.datasets.weights_table import read_weight_rows
from palpate_edge.jig.jig_table import read_jig_table


@pytest.fixture
def person(bench, tmp_path):
    """A person with a sensor's folder that has the jig's plan."""
    files = bench.files(tmp_path / "presses")
    source = [str(files.folder / "sensor.toml"), "-o", str(files.folder / "jig.scad")]
    result = CliRunner().invoke(jig, source, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return Person(bench, files)


def holes_of(person):
    return read_jig_table(person.runner.files.folder / "jig.csv")


@pytest.mark.slow
def test_from_hole_to_hole_to_the_calibration_file(person, bench):
    files, holes = person.runner.files, holes_of(person)
    person.to_presses("Presses through the jig")
    for hole in holes[:5]:
        assert f"into hole {hole.number}, {hole.theta_deg:g} deg" in person.runner.view.instruction
        person.take(*bench.through(hole))
    assert person.verdict == (Verdict.WARN, "5 of 17 presses: more make position and force surer")
    again = Person(bench, files)  # as after a power cut
    again.rest(0.2)
    assert (again.title, again.runner.view.done) == ("Presses through the jig", 5)
    for hole in holes[5:]:
        again.take(*bench.through(hole))
    rows = read_weight_rows(files.folder / "weights.csv")
    assert [(row.theta_deg, row.phi_deg) for row in rows] == [
        (hole.theta_deg, hole.phi_deg) for hole in holes
    ]
    assert again.verdict[0] is Verdict.OK
    again.next()
    again.rest(0.1)
    assert again.title == "Result"
    assert again.verdict[0] is Verdict.OK
    assert any(words in again.verdict[1] for words in ("holes left out in turn", "the jig confirms"))
    source = load_calibration(files.calibration).source
    assert source.jig is not None
    assert (source.jig.holes, source.presses, source.weighed) == (17, 0, 17)
    assert source.jig.left_out_mm <= source.jig.without_mm < 1.2


@pytest.mark.slow
def test_the_wrong_hole_is_refused_and_the_scale_may_take_turns(person, bench):
    holes = holes_of(person)
    person.to_presses("Presses through the jig")
    person.show(bench.through(holes[8])[0])
    with pytest.raises(ConfigError, match="deg beside hole 1: use that hole"):
        person.runner.answer("take")
    person.runner.answer("scale")
    person.rest(0.1)
    assert person.title == "Presses on the scale"
    person.press(0)
    assert person.runner.view.done == 1
    person.runner.answer("jig")
    person.rest(0.1)
    assert (person.title, person.runner.view.done) == ("Presses through the jig", 0)
    person.take(*bench.through(holes[0]))
    assert "into hole 2" in person.runner.view.instruction
    person.runner.answer("undo")
    person.rest(0.1)
    assert "into hole 1" in person.runner.view.instruction
