"""``palpate-edge --help``: whole summaries, and an example for each command."""

from __future__ import annotations

import re

import pytest
from click.testing import CliRunner

from palpate_edge.cli.main import cli


def test_no_summary_is_cut_off():
    """At 80 columns, the width of a plain terminal."""
    output = CliRunner().invoke(cli, ["--help"], terminal_width=80).output
    summaries = output.split("Commands:\n")[1].splitlines()
    assert len(summaries) == len(cli.commands) >= 11
    assert [line for line in summaries if not line.endswith(".") or line.endswith("...")] == []


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_each_command_has_an_example(name):
    output = CliRunner().invoke(cli, [name, "--help"], terminal_width=80).output
    assert re.search(rf"^  Examples?:\n    palpate-edge {name} .*-", output, re.MULTILINE), output
