"""``palpate-host bus check-eds``."""

from __future__ import annotations

import sys
from pathlib import Path

import click

FOUND_ERRORS = 1


@click.command("check-eds")
@click.argument("paths", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--quiet", is_flag=True, help="Print errors only, no warnings.")
def check_eds(paths: tuple[Path, ...], quiet: bool) -> None:
    """Check electronic data sheets against CiA 306 and CiA 301.

    Each finding is printed on one line: file, line number, problem, remedy. Exit status: 0 no error, 1 errors
    found.

    \b
    Examples:
      palpate-host bus check-eds firmware/fingertip.eds
      palpate-host bus check-eds --quiet firmware/*.eds
    """
    from palpate_bus.eds.check import check_file  # noqa: PLC0415 - no other command needs it
    from palpate_bus.eds.text import Severity  # noqa: PLC0415

    failed = False
    for path in paths:
        findings = check_file(path)
        errors = sum(finding.severity is Severity.ERROR for finding in findings)
        failed = failed or bool(errors)
        for finding in findings:
            if finding.severity is Severity.ERROR or not quiet:
                click.echo(finding.text(str(path)))
        click.echo(f"{path}: {errors} errors, {len(findings) - errors} warnings")
    if failed:
        sys.exit(FOUND_ERRORS)
