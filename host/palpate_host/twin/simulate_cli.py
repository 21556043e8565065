"""``palpate-host simulate``: the twin's parts, each a command."""

from __future__ import annotations

import click

from palpate_host.lazy_group import LazyGroup

COMMANDS = {  # name: module and attribute, and what --help says of it
    "dome": ("palpate_host.twin.dome.cli:dome", "The dome by finite elements and its library."),
    "sensor": ("palpate_host.twin.sensor_cli:sensor", "A sensor.toml in figures and as a drawing."),
    "dataset": ("palpate_host.twin.camera.cli:dataset", "Press datasets of simulated sensors."),
    "paper": ("palpate_host.twin.hand.cli:paper", "The paper's Figs. 17 and 20: an object turned in a hand."),
    "loop": ("palpate_host.twin.hand.cli:loop", "Hand, fingertips, bus, drives and host in lock step."),
    "hand": ("palpate_host.twin.hand.cli:hand", "Check a hand.toml: print and draw its hand."),
    "fingertips": (
        "palpate_host.twin.hand.live_cli:fingertips",
        "Made-up, calibrated sensors for a hand.",
    ),
    "live": (
        "palpate_host.twin.hand.live_cli:live",
        "Hand, drives and cameras in real time.",
    ),
    "film": ("palpate_host.twin.hand.film_cli:film", "A film of what a simulated hand did."),
    "camera": ("palpate_host.twin.camera.cli:camera", "A simulated sensor's camera, live, in shared memory."),
}


@click.command(cls=LazyGroup, table=COMMANDS)
def simulate() -> None:
    """The twin: what the sensor and the hand would do."""
