"""Commands whose code is imported when they are called, so that `bus log` does not wait for MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import click

from palpate_edge.common.plugins import load_part
from palpate_host.common.plugin_groups import COMMANDS

PLUGIN = "plugin"
"""In place of a module: the command is registered as an entry point."""


class LazyGroup(click.Group):
    """A group made from a table: name -> (``module:attribute`` or ``plugin:name``, summary for --help)."""

    def __init__(self, *args: Any, table: Mapping[str, tuple[str, str]], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._table = table

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        return list(self._table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in self._table:
            return None
        module, attribute = self._table[cmd_name][0].split(":")
        if module == PLUGIN:
            command = load_part(COMMANDS, attribute, f"palpate-host {attribute}")
        else:
            command = getattr(import_module(module), attribute)
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in self._table.items()])
