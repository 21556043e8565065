"""``palpate-host simulate``: the twin's parts, each a command."""

from __future__ import annotations

import click

from palpate_host.common.lazy_group import LazyGroup

COMMANDS = {  # name: module and attribute, and what --help says of it
    "dome": ("palpate_twin.cli.dome:dome", "The dome by finite elements and its library."),
    "sensor": ("palpate_twin.cli.sensor:sensor", "A sensor.toml in figures and as a drawing."),
    "dataset": ("palpate_twin.cli.camera:dataset", "Press datasets of simulated sensors."),
    "paper": ("palpate_twin.cli.hand:paper", "The paper's Figs. 17 and 20: an object turned in a hand."),
    "loop": ("palpate_twin.cli.hand:loop", "Hand, fingertips, bus, drives and host in lock step."),
    "hand": ("palpate_twin.cli.hand:hand", "Check a hand.toml: print and draw its hand."),
    "fingertips": (
        "palpate_twin.cli.live:fingertips",
        "Made-up, calibrated sensors for a hand.",
    ),
    "live": (
        "palpate_twin.cli.live:live",
        "Hand, drives and cameras in real time.",
    ),
    "film": ("palpate_twin.cli.film:film", "A film of what a simulated hand did."),
    "camera": ("palpate_twin.cli.camera:camera", "A simulated sensor's camera, live, in shared memory."),
}


@click.command(cls=LazyGroup, table=COMMANDS)
def simulate() -> None:
    """The twin: what the sensor and the hand would do."""
