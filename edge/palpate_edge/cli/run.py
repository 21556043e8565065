"""``palpate-edge run``: the fingertip's daemon."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.cli.options import config_option


@click.command()
@config_option
def run(config_path: Path) -> None:
    """Run the fingertip's daemon until SIGTERM or Ctrl-C.

    The daemon reads frames, estimates contacts and publishes them on the bus. It logs to standard error, with
    priorities when systemd collects it. A lost camera or bus is reopened; other errors end the daemon with
    the exit statuses of `palpate-edge --help`.

    \b
    Example:
      palpate-edge run --config finger-1.toml
    """
    from palpate_edge.common.logs import logging_to_stderr  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.daemon.daemon import run as serve  # noqa: PLC0415

    config = read_config(config_path)
    with logging_to_stderr(config.name):
        serve(config)
