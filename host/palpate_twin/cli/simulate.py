"""Command group ``palpate-host simulate``: one command per part of the twin."""

from __future__ import annotations

import click

from palpate_host.common.lazy_group import LazyGroup

COMMANDS = {  # name: module and attribute, line in --help
    "dome": ("palpate_twin.cli.dome:dome", "Compute the dome's deformation by finite elements."),
    "sensor": ("palpate_twin.cli.sensor:sensor", "Check a sensor.toml; print and draw its bead positions."),
    "dataset": ("palpate_twin.cli.camera:dataset", "Write a press dataset of a simulated sensor."),
    "paper": ("palpate_twin.cli.hand:paper", "Reproduce the paper's Figs. 17 and 20."),
    "loop": ("palpate_twin.cli.hand:loop", "Run hand, fingertips, bus, drives and host in lock step."),
    "shake": ("palpate_twin.cli.shake:shake", "Push a held object; print how it keeps its pose."),
    "gait": ("palpate_twin.cli.gait:gait", "Turn a held object far by finger gaiting."),
    "hand": ("palpate_twin.cli.hand:hand", "Check a hand.toml; print and draw its hand."),
    "fingertips": ("palpate_twin.cli.live:fingertips", "Create calibrated sensors for a hand."),
    "live": ("palpate_twin.cli.live:live", "Simulate hand, drives and cameras in real time."),
    "film": ("palpate_twin.cli.film:film", "Make a film of a simulated hand's motion."),
    "press-rig": ("palpate_twin.cli.press_rig:press_rig", "Simulate a 3-D printer that presses a fingertip."),
    "camera": ("palpate_twin.cli.camera:camera", "Simulate a sensor's camera in shared memory."),
}


@click.command(cls=LazyGroup, table=COMMANDS)
def simulate() -> None:
    """Simulate sensors, cameras, drives and hands.

    \b
    Examples:
      palpate-host simulate sensor demo/recording/press/sensor.toml
      palpate-host simulate hand --hand table4
    """
