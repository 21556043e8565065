"""``palpate-host --help`` and the help of every group: whole summaries at the width of a plain terminal."""

from __future__ import annotations

from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from palpate_host.cli.main import cli


def groups(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], int]]:
    """Yield the words of each group of commands and the number of its commands."""
    if not isinstance(command, click.Group):
        return
    context = click.Context(command)
    names = command.list_commands(context)
    yield words, len(names)
    for name in names:
        if (part := command.get_command(context, name)) is not None:
            yield from groups(part, (*words, name))


GROUPS = dict(groups(cli))


def test_the_groups_are_found() -> None:
    assert {(), ("bus",), ("bus", "sdo"), ("simulate", "dome"), ("command",), ("az",)} <= GROUPS.keys()


@pytest.mark.parametrize("words", GROUPS, ids=" ".join)
def test_no_summary_is_cut_off(words: tuple[str, ...]) -> None:
    """The width is 80 columns; click ends a summary that does not fit in "..."."""
    output = CliRunner().invoke(cli, [*words, "--help"], terminal_width=80).output
    summaries = output.split("Commands:\n")[1].splitlines()
    assert len(summaries) == GROUPS[words]
    assert [line for line in summaries if not line.endswith(".") or line.endswith("...")] == []
