"""Run benchmarks by name and print their tables."""

from __future__ import annotations

import click
import cv2

from bench import (
    bus,
    estimate_to_bus,
    estimator,
    gait_tick,
    host,
    instructions,
    latency,
    node,
    pose_tick,
    startup,
    tick,
    twin,
    twin_hand,
    vision,
)
from palpate_edge.common.entry_point import run_cli

TABLES = {
    "estimator": estimator.report,
    "vision": vision.report,
    "start": startup.report,
    "instructions": instructions.report,
    "bus": bus.report,
    "node": node.report,
    "estimate-to-bus": estimate_to_bus.report,
    "host": host.report,
    "tick": tick.report,
    "latency": latency.report_of_a_demo,
    "camera": twin.report,
    "hand": twin_hand.report,
    "pose-tick": pose_tick.report,
    "gait-tick": gait_tick.report,
}


@click.command()
@click.argument("tables", nargs=-1, type=click.Choice(list(TABLES)))
def main(tables: tuple[str, ...]) -> None:
    """Run benchmarks on one core and print their tables. Without TABLES, run all.

    \b
    Examples:
      python -m bench                   # all, about two minutes
      python -m bench camera hand       # the twin's camera; its hand and object
      make bench TABLES="tick latency"
    """
    cv2.setNumThreads(1)
    for name in tables or TABLES:
        click.echo(TABLES[name]() + "\n")


if __name__ == "__main__":
    run_cli(main)
