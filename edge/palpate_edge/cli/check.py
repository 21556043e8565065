"""``palpate-edge check``: the state of each part of a fingertip."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import click

from palpate_edge.cli.options import config_option


@click.command()
@config_option
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of a table.")
def check(config_path: Path, as_json: bool) -> None:
    """Report the state of each part of a fingertip.

    Each part has a value, a limit, a verdict (ok, warn, fail, absent) and a remedy. If the daemon runs, its
    health report is evaluated, with its counters; otherwise camera and bus are tried for a second, without
    sending.

    \b
    Examples:
      palpate-edge check --config finger-1.toml
      palpate-edge check --config finger-1.toml --json | jq '.[] | select(.verdict != "ok")'

    Exit status: 0 when no part fails, 1 when a part fails.
    """
    import msgspec  # noqa: PLC0415

    from palpate_edge.daemon.check_rows import as_table, exit_status  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.daemon.health import read_health  # noqa: PLC0415
    from palpate_edge.daemon.self_check import check as check_parts  # noqa: PLC0415

    config = read_config(config_path)
    report = read_health(config.name, config.health, time.monotonic())
    rows = check_parts(config, report)
    if as_json:
        click.echo(msgspec.json.encode(rows).decode())
    else:
        click.echo(f"{config.name}: {'running' if report else 'not running, camera and bus were tried'}")
        click.echo(as_table(rows))
    sys.exit(exit_status(rows))
