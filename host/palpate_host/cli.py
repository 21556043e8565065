"""palpate-host: the hand's side of the bus."""

from __future__ import annotations

import click

from palpate_edge import __version__
from palpate_edge.cli import run_cli
from palpate_host.bus.cli import bus
from palpate_host.demo.cli import demo
from palpate_host.run_cli import contract, replay, run
from palpate_host.twin.cli import drives


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="palpate-host")
def cli() -> None:
    """Touch for robot hands, the part on the host."""


for _command in (run, demo, replay, contract, drives, bus):
    cli.add_command(_command)


def main() -> None:
    """Entry point: a refusal becomes one line on stderr and an exit status that is not 0."""
    run_cli(cli)


if __name__ == "__main__":
    main()
