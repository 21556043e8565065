"""``palpate-host bus budget``."""

from __future__ import annotations

import sys

import click

DOES_NOT_FIT = 1


@click.command()
@click.option(
    "--fingertips", type=click.IntRange(0, 100), default=3, show_default=True, help="Number of fingertips."
)
@click.option(
    "--joints", type=click.IntRange(0, 100), default=3, show_default=True, help="Joints per finger."
)
@click.option("--drives", type=click.IntRange(0, 120), help="Number of all drives, instead of --joints.")
@click.option(
    "--fps", type=click.FloatRange(0, 1000), default=30, show_default=True, help="Camera frames per second."
)
@click.option(
    "--tick", type=click.FloatRange(1, 1000), default=100, show_default=True, help="Host's rate, Hz."
)
@click.option(
    "--bitrate", type=click.IntRange(10_000, 1_000_000), default=1_000_000, show_default=True, help="bit/s."
)
@click.option(
    "--fd",
    is_flag=True,
    help="Compute a CAN FD bus: a contact is one CAN FD frame, and so is each PDO of a drive.",
)
@click.option(
    "--classic-drives",
    is_flag=True,
    help="With --fd: drives send and receive classic frames, as palpate's do.",
)
@click.option(
    "--axes",
    type=click.IntRange(1, 8),
    help="With --fd: number of drives that are axes of one node, with one CAN FD frame each way.",
)
@click.option(
    "--data-bitrate",
    type=click.IntRange(10_000, 8_000_000),
    default=5_000_000,
    show_default=True,
    help="bit/s of the data phase of CAN FD frames, with --fd.",
)
@click.option(
    "--heartbeat-ms",
    type=click.FloatRange(1, 10_000),
    default=100,
    show_default=True,
    help="Heartbeat time of every node, ms.",
)
@click.option(
    "--time-stamps",
    type=click.FloatRange(0, 1000),
    default=20,
    show_default=True,
    help="Time stamps (1013h) per second.",
)
@click.option(
    "--sdo", type=click.FloatRange(0, 10_000), default=20, show_default=True, help="SDO transfers per second."
)
@click.option(
    "--poses",
    type=click.IntRange(0, 100),
    default=0,
    show_default=True,
    help="Number of the fingertips that send poses (TPDO 6 to 9).",
)
def budget(
    fingertips: int,
    joints: int,
    drives: int | None,
    fps: float,
    tick: float,
    bitrate: int,
    fd: bool,
    classic_drives: bool,
    axes: int | None,
    data_bitrate: int,
    heartbeat_ms: float,
    time_stamps: float,
    sdo: float,
    poses: int,
) -> None:
    """Compute the bus load of a hand.

    The load is computed from exact frame lengths, with mean and worst-case bit stuffing.

    Exit status: 0 the load fits, 1 it does not fit.

    \b
    Examples:
      palpate-host bus budget
      palpate-host bus budget --joints 5 --fps 120
      palpate-host bus budget --fingertips 10 --drives 0 --fps 120 --bitrate 500000
      palpate-host bus budget --fingertips 10 --drives 15 --fps 120 --tick 250 --fd
      palpate-host bus budget --fingertips 10 --fps 120 --drives 9 --fd --classic-drives
      palpate-host bus budget --fingertips 10 --drives 15 --fps 120 --tick 250 --fd --axes 5
    """
    if axes is not None and (classic_drives or not fd):
        raise click.UsageError("--axes needs --fd without --classic-drives: several axes need CAN FD frames")
    from rich.console import Console  # noqa: PLC0415 - no other command of the hub needs it

    from palpate_bus.load.budget import BudgetCase  # noqa: PLC0415
    from palpate_bus.load.budget import budget as budget_of  # noqa: PLC0415
    from palpate_bus.load.budget_table import show  # noqa: PLC0415

    case = BudgetCase(
        fingertips=fingertips,
        joints=fingertips * joints if drives is None else drives,
        frames_per_s=fps,
        tick_Hz=tick,
        bitrate=bitrate,
        data_bitrate=data_bitrate if fd else None,
        classic_drives=classic_drives,
        heartbeat_ms=heartbeat_ms,
        time_stamps_per_s=time_stamps,
        sdo_per_s=sdo,
        pose_fingertips=min(poses, fingertips),
    )
    result = budget_of(case if axes is None else case.sharing_nodes(axes))
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = 120
    show(result, console)
    if result.verdict == "does not fit":
        sys.exit(DOES_NOT_FIT)
