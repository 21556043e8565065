"""Draw Figs. 17 and 20: roll, pitch and yaw of the object over time under the proposed and the blind law."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate_host.common.figure_file import save_figure
from palpate_twin.paper.figure_data import AXES, STEP_DEG, Law, Result

COLOURS = ("tab:blue", "tab:orange", "tab:green")
LINES = ("-", ":")
COLUMNS = (Law.PROPOSED, Law.BLIND)
NAMES = {Law.PROPOSED: "proposed", Law.BLIND: "blind (Tahara)"}


def draw_turns(results: Sequence[Result], path: Path) -> None:
    """Draw the runs of one hand, three turns by two laws (a-f). The path's suffix selects the format."""
    engines = list(dict.fromkeys(result.case.engine for result in results))
    with mpl.rc_context({"font.size": 9, "svg.hashsalt": "palpate", "svg.fonttype": "none"}):
        figure = Figure(figsize=(9, 9), layout="constrained")
        panels = figure.subplots(3, 2, sharex=True, sharey=True)
        for row in range(3):
            for column, law in enumerate(COLUMNS):
                axes = panels[row, column]
                letter = "abcdef"[2 * row + column]
                axes.set_title(f"({letter}) {AXES[row]} {STEP_DEG:g} deg, {NAMES[law]}", loc="left")
                shown = [result for result in results if (result.case.axis, result.case.law) == (row, law)]
                _draw(axes, shown, engines)
        for axes in panels[:, 0]:
            axes.set_ylabel("deg")
        for axes in panels[-1]:
            axes.set_xlabel("s")
        panels[0, 0].legend(loc="center right", fontsize=8)
        engines_text = ", ".join(f"{engine} {line}" for engine, line in zip(engines, LINES, strict=False))
        figure.suptitle(f"{results[0].case.hand_toml.stem}: turn of the object; engines: {engines_text}")
        save_figure(figure, path)


def _draw(axes: Axes, results: Sequence[Result], engines: Sequence[str]) -> None:
    axes.axhline(STEP_DEG, color="0.6", linewidth=0.8, linestyle="--")
    axes.grid(alpha=0.3)
    for result in results:
        style = LINES[engines.index(result.case.engine)]
        for angle, (name, colour) in enumerate(zip(AXES, COLOURS, strict=True)):
            label = name if style == LINES[0] else None
            values = result.outcome.rpy_deg[:, angle]
            axes.plot(result.outcome.time_s, values, style, color=colour, label=label, linewidth=1.3)
            if style == LINES[0] and len(result.marker_s):
                axes.plot(result.marker_s, result.marker_rpy_deg[:, angle], ".", color=colour, markersize=3)
