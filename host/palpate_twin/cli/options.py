"""Click types and options shared by several commands of the twin."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from palpate_host.config.packaged import MODELS

FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)
_Command = Callable[..., Any]
PACKAGED = {name: MODELS / f"{name}.toml" for name in ("table3", "table4", "table4-wide", "table4-four")}


def config_option(text: str) -> Callable[[_Command], _Command]:
    """Return the required option --config with its help text."""
    return click.option("--config", "config_path", type=FILE, required=True, help=text)


def hand_file(name: str) -> Path:
    """Return the hand.toml of a packaged hand, or `name` as a path."""
    return PACKAGED.get(name, Path(name))


hand_option = click.option(
    "--hand",
    "hand_name",
    default="table4-wide",
    show_default=True,
    metavar="table3|table4|table4-wide|table4-four|FILE",
    help="Hand of the paper's Table 3 or 4 (-wide: with a wider object, -four: of four fingers),"
    " or a hand.toml with [twin].",
)

friction_option = click.option(
    "--friction",
    type=click.FloatRange(0.05, 5.0),
    help="Friction coefficient of the tips.  [default: from hand.toml]",
)

noise_seed_option = click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Random seed of the noise."
)

jobs_option = click.option(
    "--jobs", type=click.IntRange(1), help="Number of parallel runs.  [default: one per core]"
)


def noise_option(default_mm: float) -> Callable[[_Command], _Command]:
    """Return the option --noise."""
    return click.option(
        "--noise",
        "noise_mm",
        type=click.FloatRange(0.0, 5.0),
        default=default_mm,
        show_default=True,
        help="Noise of contact positions: standard deviation along each axis in mm.",
    )


def force_noise_option(default: float) -> Callable[[_Command], _Command]:
    """Return the option --force-noise."""
    return click.option(
        "--force-noise",
        type=click.FloatRange(0.0, 0.5),
        default=default,
        show_default=True,
        help="Noise of contact forces: standard deviation along each axis over the force.",
    )


def results_option(folder: str, holds: str = "results.md") -> Callable[[_Command], _Command]:
    """Return the option --output for a folder that holds results."""
    return click.option(
        "-o",
        "--output",
        type=FOLDER,
        default=Path(folder),
        show_default=True,
        help=f"Folder for {holds}.",
    )
