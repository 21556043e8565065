"""The experiment's report: report.html with its picture embedded, report.md with the same table."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_host.config.control_config import ControlMode
from palpate_host.experiment.protocol import ExperimentConfig
from palpate_host.experiment.result import TrialResult

ANGLES = ("roll", "pitch", "yaw")
COLOURS = ("tab:blue", "tab:orange", "tab:green")
LINES = {ControlMode.PROPOSED: "-", ControlMode.BLIND: "--"}
LAWS = {ControlMode.PROPOSED: "proposed", ControlMode.BLIND: "blind (Tahara)"}
HEADER = (
    "turn",
    "pose",
    "law",
    "error deg",
    "true error deg",
    "roll, pitch, yaw deg",
    "settled s",
    "slip mm",
    "ended",
)
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 1000px; margin: 2em auto;
       padding: 0 1em; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 0.2em 0.7em; text-align: right; border-bottom: 1px solid #ddd; }
th:nth-child(-n+3), td:nth-child(-n+3) { text-align: left; } img { width: 100%; }
"""


def write_report(folder: Path, experiment: ExperimentConfig, results: Sequence[TrialResult]) -> Path:
    """Write report.html, report.md and turns.svg.

    Return the page. Raises ConfigError when they cannot be written.
    """
    rows = [_row(result) for result in results]
    picture = draw(results)
    page = folder / "report.html"
    write_atomically(folder / "turns.svg", picture, ConfigError)
    write_atomically(folder / "report.md", _markdown(experiment, rows).encode(), ConfigError)
    write_atomically(page, _html(experiment, rows, picture).encode(), ConfigError)
    return page


def draw(results: Sequence[TrialResult]) -> bytes:
    """Return an SVG with a panel for each turn and pose: roll, pitch and yaw by the camera, both laws."""
    panels = list(dict.fromkeys((result.case.turn.name, result.case.pose.name) for result in results))
    rows = (len(panels) + 1) // 2
    with mpl.rc_context({"font.size": 9, "svg.hashsalt": "palpate", "svg.fonttype": "none"}):
        figure = Figure(figsize=(9, 2.6 * rows), layout="constrained")
        grid = figure.subplots(rows, 2, squeeze=False, sharex=True)
        for number, (turn, pose) in enumerate(panels):
            axes = grid[number // 2, number % 2]
            axes.set_title(f"({chr(97 + number)}) {turn}, object {pose}", loc="left")
            _panel(axes, [r for r in results if (r.case.turn.name, r.case.pose.name) == (turn, pose)])
        for axes in grid.ravel()[len(panels) :]:
            axes.axis("off")
        for axes in grid[-1]:
            axes.set_xlabel("s")
        for axes in grid[:, 0]:
            axes.set_ylabel("deg")
        grid[0, 0].legend(fontsize=7, ncols=2)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def _panel(axes: Axes, results: Sequence[TrialResult]) -> None:
    axes.grid(alpha=0.3)
    for target in set(results[0].case.turn.rpy_deg):
        axes.axhline(target, color="0.6", linewidth=0.8, linestyle=":")
    for result in results:
        for angle, name in enumerate(ANGLES):
            values = result.rpy_deg[:, angle]
            label = f"{name}, {LAWS[result.case.law]}"
            axes.plot(result.time_s, values, LINES[result.case.law], color=COLOURS[angle], label=label)


def _row(result: TrialResult) -> tuple[str, ...]:
    true = result.true_error_deg
    return (
        result.case.turn.name,
        result.case.pose.name,
        LAWS[result.case.law],
        f"{result.error_deg:.2f}",
        "" if true is None else f"{true:.2f}",
        ", ".join(f"{angle:.1f}" for angle in result.rpy_deg[-1]),
        "" if result.settling_s is None else f"{result.settling_s:.1f}",
        "" if result.slip_mm is None else f"{result.slip_mm.max():.2f}",
        result.failure or "completed",
    )


def _lines(experiment: ExperimentConfig, rows: Sequence[tuple[str, ...]]) -> list[str]:
    by_law = {}
    for law in dict.fromkeys(row[2] for row in rows):
        errors = [float(row[3]) for row in rows if row[2] == law]
        by_law[law] = f"{law}: {sum(errors) / len(errors):.2f} deg on average, {max(errors):.2f} at most"
    where = "the simulated hand" if experiment.on == "twin" else "the hand"
    return [
        f"{len(rows)} trials on {where}, {experiment.seconds:g} s each. {'. '.join(by_law.values())}.",
        "Errors are the angle to the target at the end, by the external camera's marker; angles are counted"
        " from the start of the turn. True errors are the simulation's.",
    ]


def _markdown(experiment: ExperimentConfig, rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["# Turning an object: both laws", "", *_lines(experiment, rows), "", "![turns](turns.svg)", ""]
    lines += ["| " + " | ".join(HEADER) + " |", "|---|---|---|" + "---:|" * (len(HEADER) - 3)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _html(experiment: ExperimentConfig, rows: Sequence[tuple[str, ...]], picture: bytes) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in HEADER)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    summary = "".join(f"<p>{escape(line)}</p>" for line in _lines(experiment, rows))
    source = base64.b64encode(picture).decode()
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>palpate experiment</title>'
        f"<style>{STYLE}</style></head>\n<body><h1>Turning an object: both laws</h1>{summary}"
        f'<img alt="roll, pitch and yaw in every trial" src="data:image/svg+xml;base64,{source}">'
        f"<table><tr>{head}</tr>{body}</table></body></html>\n"
    )
