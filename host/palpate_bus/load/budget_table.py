"""The budget for the terminal: a bar for each kind of frame, and a table of ordinary hands."""

from __future__ import annotations

from dataclasses import replace

from rich import box
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from palpate_bus.load.budget import (
    FITS_PERCENT,
    Budget,
    BudgetCase,
    budget,
    further_classic_frames,
    largest_frame_rate,
    largest_tick_rate,
    most_drives,
    on_classic_can,
)

BAR_WIDTH = 40
_COLOURS = {"fits": "green", "tight": "yellow", "does not fit": "red"}
_GROUPS = {"fingertip": "cyan", "drive": "magenta"}

USUAL_CASES = (
    BudgetCase(fingertips=3, joints=9, frames_per_s=30),
    BudgetCase(fingertips=3, joints=9, frames_per_s=120),
    BudgetCase(fingertips=3, joints=15, frames_per_s=30),
    BudgetCase(fingertips=3, joints=15, frames_per_s=120),
    BudgetCase(fingertips=5, joints=15, frames_per_s=120),
    BudgetCase(fingertips=10, joints=0, frames_per_s=120),
    BudgetCase(fingertips=10, joints=9, frames_per_s=120),
    BudgetCase(fingertips=10, joints=15, frames_per_s=120),
    BudgetCase(fingertips=10, joints=30, frames_per_s=120),
)


def breakdown(result: Budget) -> RenderableType:
    """Return a table of the frames of one case, each with a bar of its mean load."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("frame")
    for title in ("bytes", "a second", "bits mean", "worst", "load %"):
        table.add_column(title, justify="right")
    data_bitrate = result.case.data_bitrate
    data_phase = f", FD at {data_bitrate / 1000:g} kbit/s" if data_bitrate else ""
    table.add_column(f"of {result.case.bitrate / 1000:g} kbit/s{data_phase}", width=BAR_WIDTH)
    largest = max(result.percent_of(stream) for stream in result.streams)
    for stream in result.streams:
        percent = result.percent_of(stream)
        colour = _GROUPS.get(stream.name.split()[0], "blue")
        table.add_row(
            stream.name,
            str(stream.length),
            f"{stream.per_s:.0f}",
            f"{stream.mean:.1f}",
            f"{stream.worst:.0f}",
            f"{percent:.2f}",
            bar(percent, largest, colour),
        )
    return Group(table, summary(result))


def summary(result: Budget) -> Text:
    """Return the total load, the verdict and the burst as text."""
    case = result.case
    text = Text(
        f"{case.fingertips} fingertips at {case.frames_per_s:g} FPS, {case.drives} drives"
        f"{f' in {case.joints + len(case.axis_nodes)} nodes' if case.axis_nodes else ''} at "
        f"{case.tick_Hz:g} Hz, {result.frames_per_s:.0f} frames/s: {result.mean_percent:.1f} % mean, "
        f"{result.worst_percent:.1f} % at worst, "
    )
    text.append(result.verdict, style=_COLOURS[result.verdict])
    text.append(
        f" (up to {FITS_PERCENT:g} % fits).\nEverything at once takes {result.burst_us / 1000:.1f} ms "
        f"of a tick of {1000 / case.tick_Hz:g} ms."
    )
    if case.fingertips:
        text.append(f" The cameras may run at up to {largest_frame_rate(case):.0f} FPS.")
    if case.data_bitrate is not None:
        text.append(f"\n{beside_classic_can(result)}")
    return text


def beside_classic_can(result: Budget) -> Text:
    """Return how many classic frames fit beside a CAN FD case, and what a classic bus carries of it."""
    case = on_classic_can(result.case)
    alone = budget(case)
    text = Text(
        f"Beside it there is room for {further_classic_frames(result)} classic frames/s of 8 bytes.\n"
        f"A bus of classic CAN with the same hand: {alone.mean_percent:.1f} % mean, "
        f"{alone.worst_percent:.1f} % at worst, "
    )
    text.append(alone.verdict, style=_COLOURS[alone.verdict])
    if alone.verdict == "fits":
        return text.append(".")
    drives, tick_Hz = most_drives(case), largest_tick_rate(case)
    parts = [
        f"drives at {tick_Hz:.0f} Hz" if tick_Hz >= 1.0 else "",
        f"{drives} drives at {case.tick_Hz:g} Hz" if drives else "",
        f"cameras at {frames_per_s:.0f} FPS" if (frames_per_s := largest_frame_rate(case)) >= 1.0 else "",
    ]
    fits = ", or with ".join(part for part in parts if part)
    return text.append(
        f". It fits with {fits}, the rest as above." if fits else "; nor with less of one kind."
    )


def usual_hands(like: BudgetCase) -> Table:
    """Return a table of USUAL_CASES with the tick, bit rate and reserves of `like`."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("fingertips", "drives", "FPS", "frames/s", "mean %", "worst %"):
        table.add_column(title, justify="right")
    table.add_column("worst case", width=BAR_WIDTH)
    table.add_column("verdict")
    for usual in USUAL_CASES:
        case = replace(
            like,
            fingertips=usual.fingertips,
            joints=usual.joints,
            frames_per_s=usual.frames_per_s,
            pose_fingertips=0,
            axis_nodes=(),
        )
        if like.axis_nodes:
            case = case.sharing_nodes(max(like.axis_nodes))
        result = budget(case)
        colour = _COLOURS[result.verdict]
        table.add_row(
            str(case.fingertips),
            str(case.drives),
            f"{case.frames_per_s:g}",
            f"{result.frames_per_s:.0f}",
            f"{result.mean_percent:.1f}",
            f"{result.worst_percent:.1f}",
            bar(min(result.worst_percent, 100.0), 100.0, colour),
            Text(result.verdict, style=colour),
        )
    return table


def bar(value: float, full: float, colour: str) -> Text:
    """Return a bar with BAR_WIDTH characters at `full` and a resolution of an eighth of a character."""
    eighths = round(8 * BAR_WIDTH * value / full) if full else 0
    last = " ▏▎▍▌▋▊▉"[eighths % 8].strip()
    return Text("█" * (eighths // 8) + last, style=colour)


def show(result: Budget, console: Console) -> None:
    """Print all figures of one case, then those of ordinary hands on the same bus."""
    console.print(breakdown(result))
    console.print()
    console.print(usual_hands(result.case))
