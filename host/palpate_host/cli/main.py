"""palpate-host: the hand's side of the bus."""

from __future__ import annotations

import click

from palpate_edge import __version__
from palpate_edge.common.entry_point import run_cli
from palpate_host.common.lazy_group import LazyGroup

COMMANDS = {  # name: module and attribute, and its summary in --help
    "demo": ("plugin:demo", "Run a simulated hand with a live view and a report."),
    "setup": ("palpate_host.cli.setup:setup", "Write hand.toml from the nodes on the bus."),
    "run": ("palpate_host.cli.run:run", "Control the hand on its bus."),
    "check": ("palpate_host.cli.check:check", "Compare hand.toml with the nodes on its bus."),
    "command": ("palpate_host.cli.command:command", "Command a running hand: grasp, rotate, release, stop."),
    "console": ("palpate_host.cli.console:console", "Show and command a running hand in the browser."),
    "replay": ("palpate_host.cli.replay:replay", "Repeat a recorded run on a virtual clock and compare it."),
    "contract": ("palpate_host.cli.run:contract", "Print the header that binds a bus log to a hand."),
    "record": ("palpate_host.cli.record:record", "Record bus and host status: bus logs and MCAP."),
    "view": ("palpate_host.cli.view:view", "Show the hand in 3-D, live or from a recording (Rerun)."),
    "foxglove": ("palpate_host.cli.foxglove:foxglove", "Serve a running hand to Foxglove over a WebSocket."),
    "ros": ("palpate_host.cli.ros:ros", "Publish a running hand to ROS 2, and take commands."),
    "export": ("palpate_host.cli.export:export", "Convert a recording to MCAP, CSV or Parquet."),
    "lerobot": ("palpate_host.cli.lerobot:lerobot", "Convert recorded runs to a LeRobot dataset (v3.0)."),
    "groundtruth": (
        "palpate_host.cli.groundtruth:groundtruth",
        "Measure the object's pose by an external camera.",
    ),
    "experiment": (
        "palpate_host.cli.experiment:experiment",
        "Compare both control laws, as in the paper's Fig. 20.",
    ),
    "drives": ("plugin:drives", "Simulate a CiA 402 drive for each joint of a hand."),
    "az": ("palpate_host.cli.az:az", "Serve Oriental Motor AZ drives on RS-485 as CiA 402 nodes."),
    "simulate": ("plugin:simulate", "Simulate domes, tactile cameras and datasets (the twin)."),
    "docs": ("palpate_host.cli.documents:docs", "List the documentation pages, or print one."),
    "example": (
        "palpate_host.cli.documents:example",
        "List the example configurations, print or write one.",
    ),
    "bus": (
        "palpate_bus.cli.main:bus",
        "Run a local CAN hub; show nodes, logs and statistics.",
    ),
}


EXTRAS = {
    "demo": "demo",
    "simulate": "twin",
    "record": "record",
    "export": "record",
    "foxglove": "record",
    "lerobot": "record",
    "view": "view",
}
"""Commands that need more than the extra `host`."""


@click.command(
    cls=LazyGroup,
    table=COMMANDS,
    extras=EXTRAS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="palpate-host")
def cli() -> None:
    """Control, record and simulate a robot hand with tactile fingertips.

    \b
    Examples:
      palpate-host demo
      palpate-host bus hub --bitrate 1000000 --log traffic.log
      palpate-host run --config hand.toml
      palpate-host replay traffic.log --config hand.toml
    """


def main() -> None:
    """Entry point: a refusal becomes one line on stderr and an exit status that is not 0."""
    run_cli(cli)


if __name__ == "__main__":
    main()
