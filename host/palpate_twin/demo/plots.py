"""The report's plots as PNG bytes; time axes are in seconds since the log's first frame."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import matplotlib

matplotlib.use("Agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate_host.common.mode import Mode
from palpate_twin.demo.analysis import Analysis
from palpate_twin.demo.hand_motion import HostTick
from palpate_twin.demo.live_view import mode_name
from palpate_twin.demo.traffic import BIN_US
from palpate_twin.demo.truth import Pair
from palpate_twin.demo.turn import TurnSeries

WIDTH_IN = 10.0
DPI = 130
TRUTH = {"color": "0.55", "linewidth": 2.5, "label": "truth"}
MEASURED = {"linestyle": "none", "marker": ".", "markersize": 2.5, "color": "tab:red", "label": "on the bus"}
JOINT_COLOURS = ("tab:blue", "tab:orange", "tab:green")

_MODE_COLOUR = {
    Mode.INIT: "0.85",
    Mode.CHECK: "0.8",
    Mode.HOME: "0.75",
    Mode.READY: "0.7",
    Mode.GRASP: "bisque",
    Mode.HOLD: "tab:orange",
    Mode.RELEASE: "tab:purple",
    Mode.BLIND: "gold",
    Mode.MANIPULATE: "tab:green",
    Mode.FAULT: "tab:red",
    Mode.STOP: "tab:brown",
}


def contact_plot(pairs: Sequence[Pair], begin_us: int) -> bytes:
    """Plot contact position x, y, z in mm and normal force in N of one finger with the truth."""
    figure = Figure(figsize=(WIDTH_IN, 5.2), layout="constrained")
    rows = figure.subplots(4, 1, sharex=True)
    times_s = [(pair.contact.exposed_at_us - begin_us) / 1e6 for pair in pairs]
    for axis, row in enumerate(rows[:3]):
        true_mm = [math.nan if p.truth.position_mm is None else p.truth.position_mm[axis] for p in pairs]
        places_mm = [p.contact.position_mm if p.contact.in_contact else None for p in pairs]
        seen_mm = [math.nan if place is None else place[axis] for place in places_mm]
        row.plot(times_s, true_mm, **TRUTH)
        row.plot(times_s, seen_mm, **MEASURED)
        row.set_ylabel(f"{'xyz'[axis]} (mm)")
    rows[3].plot(times_s, [p.truth.normal_force_N for p in pairs], **TRUTH)
    seen_N = [p.contact.normal_force_N if p.contact.in_contact else 0.0 for p in pairs]
    rows[3].plot(
        times_s, [n if p.contact.valid else math.nan for n, p in zip(seen_N, pairs, strict=True)], **MEASURED
    )
    rows[3].set_ylabel("force (N)")
    rows[3].set_xlabel("time (s)")
    rows[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize="small", markerscale=3)
    return _png(figure)


def latency_plot(analysis: Analysis) -> bytes:
    """Plot histograms of the time from exposure to the bus, one row per finger, median and p99 marked."""
    figure = Figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
    fingers = analysis.summary.fingers
    rows = figure.subplots(len(fingers), 1, sharex=True, squeeze=False)[:, 0]
    latencies_ms = [[pair.latency_us / 1000 for pair in pairs] for pairs in analysis.pairs]
    largest_ms = max((max(values, default=0.0) for values in latencies_ms), default=0.0) or 1.0
    for row, finger, values in zip(rows, fingers, latencies_ms, strict=True):
        row.hist(values, bins=80, range=(0.0, largest_ms), color="tab:blue")
        row.set_ylabel(f"{finger.name}\nframes")
        if finger.latency_us is not None:
            for value_us, style, name in (
                (finger.latency_us.median, "-", "median"),
                (finger.latency_us.p99, "--", "99 %"),
            ):
                value_ms = value_us / 1000
                row.axvline(value_ms, color="tab:red", linestyle=style, label=f"{name} {value_ms:.1f} ms")
            row.legend(fontsize="small")
    rows[-1].set_xlabel("from exposure to the bus (ms)")
    return _png(figure)


def load_plot(analysis: Analysis) -> bytes:
    """Plot the bus load over time in bins of 0.1 s."""
    figure = Figure(figsize=(WIDTH_IN, 2.2), layout="constrained")
    axes = figure.subplots()
    load = analysis.summary.bus.bin_percent
    axes.stairs(load, [number * BIN_US / 1e6 for number in range(len(load) + 1)], fill=True, alpha=0.7)
    axes.axhline(analysis.summary.bus.mean_percent, color="tab:red", linewidth=1, label="mean")
    axes.set_ylabel("load (% of bit rate)")
    axes.set_xlabel("time (s)")
    axes.set_ylim(bottom=0)
    axes.legend(loc="lower right", fontsize="small")
    return _png(figure)


def turn_plot(turn: TurnSeries) -> bytes:
    """Plot roll, pitch and yaw of the object with the target, and the angle between truth and target."""
    figure = Figure(figsize=(WIDTH_IN, 6.2), layout="constrained")
    rows = figure.subplots(4, 1, sharex=True)
    for axis, row in enumerate(rows[:3]):
        row.plot(turn.times_s, turn.true_deg[:, axis], **TRUTH)
        row.plot(turn.times_s, turn.estimated_deg[:, axis], color="tab:red", linewidth=0.9, label="estimated")
        row.plot(turn.times_s, turn.target_deg[:, axis], "--", color="black", linewidth=0.9, label="target")
        row.set_ylabel(f"{('roll', 'pitch', 'yaw')[axis]} (deg)")
    rows[3].plot(turn.times_s, turn.error_deg, linewidth=1)
    rows[3].set_ylabel("error to\ntarget (deg)")
    rows[3].set_ylim(bottom=0)
    rows[3].set_xlabel("time (s)")
    rows[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize="small")
    return _png(figure)


def hand_plot(analysis: Analysis) -> bytes:
    """Modes, orientation error, and the torques of each finger with their limits."""
    fingers = analysis.config.fingers
    figure = Figure(figsize=(WIDTH_IN, 2.4 + 1.5 * len(fingers)), layout="constrained")
    ratios = [0.35, 1.0, *([1.0] * len(fingers))]
    rows = figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios)
    ticks = analysis.ticks
    times_s = [(tick.time_us - analysis.begin_us) / 1e6 for tick in ticks]
    _draw_modes(rows[0], ticks, times_s)
    errors = [math.nan if m.orientation_error_deg is None else m.orientation_error_deg for m in ticks]
    rows[1].plot(times_s, errors, linewidth=1)
    rows[1].set_ylabel("orientation\nerror (deg)")
    rows[1].set_ylim(bottom=0)
    torques = iter(analysis.torques)
    for row, finger in zip(rows[2:], fingers, strict=True):
        for _, colour in zip(finger.joints, JOINT_COLOURS, strict=False):
            joint = next(torques)
            stamps_s = (joint.stamps_us - analysis.begin_us) / 1e6
            row.plot(stamps_s, joint.torque_Nm, color=colour, linewidth=1, label=joint.name)
            for limit_Nm in (-joint.limit_Nm, joint.limit_Nm):
                row.axhline(limit_Nm, color="tab:red", linestyle="--", linewidth=0.8)
        row.set_ylabel(f"{finger.name}\n(N m)")
        row.legend(loc="upper right", ncols=3, fontsize="small")
    rows[-1].set_xlabel("time (s); dashed: torque limits")
    return _png(figure)


def _draw_modes(axes: Axes, ticks: Sequence[HostTick], times_s: Sequence[float]) -> None:
    """Draw a band in the colour of the mode, with a legend of the modes that occur."""
    named: set[Mode] = set()
    begin = 0
    for index in range(1, len(ticks) + 1):
        if index < len(ticks) and ticks[index].mode is ticks[begin].mode:
            continue
        mode = ticks[begin].mode
        label = None if mode in named else mode_name(mode)
        end_s = times_s[min(index, len(times_s) - 1)]
        axes.axvspan(times_s[begin], end_s, color=_MODE_COLOUR[mode], label=label, linewidth=0)
        named.add(mode)
        begin = index
    axes.set_yticks([])
    axes.set_ylabel("mode")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(_MODE_COLOUR), fontsize="small")


def _png(figure: Figure) -> bytes:
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(visible=True, alpha=0.25)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()
