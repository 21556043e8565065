"""Large turns by finger gaiting about several axes with several seeds, and their table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from palpate_host.common.command import CommandError
from palpate_twin.paper.figure_data import AXES
from palpate_twin.paper.gait_chain import run_gait_in_chain
from palpate_twin.paper.gait_trial import GaitOutcome, run_gait
from palpate_twin.paper.parallel_runs import run_each
from palpate_twin.paper.trial_parameters import Trial


@dataclass(frozen=True, slots=True)
class GaitCase:
    """One run: a turn by an angle about the hand's axis with this number, in the whole chain or not."""

    axis: int
    angle_deg: float
    trial: Trial
    in_chain: bool = False

    @property
    def name(self) -> str:
        """The row of the table."""
        return f"{AXES[self.axis]} {self.angle_deg:g} deg"


def run_case(hand_toml: Path, case: GaitCase) -> GaitOutcome | str:
    """Run one case; return why the turn was refused in place of an outcome."""
    axis = np.eye(3)[case.axis]
    try:
        if case.in_chain:
            x, y, z = (case.angle_deg * axis).tolist()
            return run_gait_in_chain(hand_toml, (x, y, z), case.trial)
        return run_gait(hand_toml, axis, case.angle_deg, case.trial)
    except CommandError as error:
        return str(error)


def run_gaits(
    hand_toml: Path, cases: Sequence[GaitCase], jobs: int, done: Callable[[], None]
) -> list[GaitOutcome | str]:
    """Run all cases, `jobs` at a time; order and results do not depend on `jobs`."""
    return run_each(partial(run_case, hand_toml), cases, jobs, done)


def gait_table(cases: Sequence[GaitCase], results: Sequence[GaitOutcome | str]) -> str:
    """Return a Markdown table with the largest values of each turn, then a line for each run that failed."""
    lines = [
        "| turn | runs | dropped | not finished | refused | regrasps | planned friction | orientation deg |"
        " place mm: at the end | most | slip mm | largest normal force N | duration s |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    notes = []
    for name in dict.fromkeys(case.name for case in cases):
        runs = [(case, result) for case, result in zip(cases, results, strict=True) if case.name == name]
        found = [result for _, result in runs if isinstance(result, GaitOutcome)]
        notes += [
            f"- {name}, seed {case.trial.seed}: {result if isinstance(result, str) else result.problem}"
            for case, result in runs
            if isinstance(result, str) or result.problem
        ]
        cells = [
            name,
            f"{len(runs)}",
            f"{sum(one.is_dropped for one in found)}",
            f"{sum(bool(one.problem) and not one.is_dropped for one in found)}",
            f"{len(runs) - len(found)}",
            *(_worst(found) if found else [""] * 8),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, "", *notes] if notes else lines)


def _worst(found: Sequence[GaitOutcome]) -> list[str]:
    return [
        f"{max(one.regrasped for one in found)}",
        f"{max(one.plan.friction for one in found):.2f}",
        f"{max(one.error_deg for one in found):.2f}",
        f"{max(one.moved_mm for one in found):.2f}",
        f"{max(one.moved_most_mm for one in found):.1f}",
        f"{max(one.slip_mm for one in found):.1f}",
        f"{max(one.normal_N for one in found):.1f}",
        f"{max(one.duration_s for one in found):.0f}",
    ]
