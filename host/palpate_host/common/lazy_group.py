"""Commands whose code is imported when they are called, so that `bus log` does not wait for MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

import click

from palpate_edge.common.errors import MissingExtraError, missing_library
from palpate_edge.common.plugins import load_part
from palpate_host.common.plugin_groups import COMMANDS

PLUGIN = "plugin"
"""In place of a module: the command is registered as an entry point."""

NO_EXTRAS: Mapping[str, str] = MappingProxyType({})


class LazyGroup(click.Group):
    """A group made from a table: name -> (``module:attribute`` or ``plugin:name``, summary for --help).

    extras: name of a command -> the extra of palpate that installs all it needs; not given: the extra of the
    first library that is missing. A command whose extra is not installed still answers --help.
    """

    def __init__(
        self,
        *args: Any,
        table: Mapping[str, tuple[str, str]],
        extras: Mapping[str, str] = NO_EXTRAS,
        **kwargs: Any,
    ) -> None:
        super().__init__(*args, **kwargs)
        self._table = table
        self._extras = extras

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        return list(self._table)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self._table:
            return None
        place, summary = self._table[cmd_name]
        module, attribute = place.split(":")
        try:
            if module == PLUGIN:
                command = load_part(COMMANDS, attribute, f"palpate-host {attribute}")
            else:
                command = getattr(import_module(module), attribute)
        except (ModuleNotFoundError, MissingExtraError) as error:
            library = error.library if isinstance(error, MissingExtraError) else missing_library(error)
            if library is None:
                raise
            name, extra = f"{ctx.command_path} {cmd_name}", self._extras.get(cmd_name, "")
            return _not_installed(name, summary, MissingExtraError(name, library, extra))
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in self._table.items()])


def _not_installed(name: str, summary: str, error: MissingExtraError) -> click.Command:
    """Return a command in place of one whose extra is not installed: its help has the way out."""

    def refuse(arguments: tuple[str, ...]) -> None:  # noqa: ARG001 - click passes what was typed
        raise error

    return click.Command(
        name.rpartition(" ")[2],
        callback=refuse,
        params=[click.Argument(["arguments"], nargs=-1)],
        help=f"{summary}\n\n{error}; then this shows its options.",
        context_settings={"ignore_unknown_options": True},
    )
