"""The example of README.md, section "From Python": run as printed, compared with the recording's truth."""

from __future__ import annotations

import csv
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.cli.main import cli

ROOT = Path(__file__).resolve().parents[2]
LINE = re.compile(r"(\d+): position (\S+) (\S+) (\S+) mm, force (\S+) N")


def code_block(language: str) -> str:
    """Return the section's block of one language."""
    section = (ROOT / "README.md").read_text().split("\n## From Python\n")[1].split("\n## ")[0]
    found = re.search(rf"```{language}\n(.*?)```", section, re.DOTALL)
    assert found is not None
    return found[1]


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Output of the example in a fresh checkout."""
    checkout = tmp_path_factory.mktemp("checkout")
    (checkout / "demo").symlink_to(ROOT / "demo")
    program, *arguments = shlex.split(code_block("sh"))
    assert program == "palpate-edge"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(checkout)
        calibrated = CliRunner().invoke(cli, arguments, catch_exceptions=False)
        assert calibrated.exit_code == 0, calibrated.output
        lines: list[str] = []
        exec(code_block("python"), {"print": lines.append})
    return "\n".join(lines)


@pytest.mark.slow
def test_the_example_prints_the_contacts_of_the_recording(printed):
    with (ROOT / "demo" / "recording" / "finger-1" / "truth.csv").open(newline="") as file:
        truth = list(csv.DictReader(file))
    errors_mm, errors_N, firm = [], [], 0
    for line in printed.splitlines():
        found = LINE.fullmatch(line)
        assert found is not None, line
        row = truth[int(found[1])]
        if row["x_mm"]:
            place_mm = [float(row[column]) for column in ("x_mm", "y_mm", "z_mm")]
            estimate_mm = [float(value) for value in found.groups()[1:4]]
            errors_mm.append(float(np.linalg.norm(np.subtract(estimate_mm, place_mm))))
            errors_N.append(abs(float(found[5]) - float(row["fn_N"])))
            firm += float(row["fn_N"]) > 0.1
    assert firm >= 0.9 * sum(float(row["fn_N"]) > 0.1 for row in truth)
    assert np.median(errors_mm) < 0.25
    assert np.median(errors_N) < 0.05
