"""Many random runs of a held object under several laws, and their table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from palpate_host.config.control_config import ControlLaw
from palpate_twin.hand.engine import LostGraspError
from palpate_twin.paper.parallel_runs import run_each
from palpate_twin.paper.random_chain import run_random_in_chain
from palpate_twin.paper.shake_random import RandomRun, RunKind, run_random
from palpate_twin.paper.trial_parameters import Trial

LAWS = (ControlLaw.POSE, ControlLaw.PAPER)
FRAMES_EVERY = 3
"""One of so many runs has rendered frames, the first among them."""


def run_one(
    hand_toml: Path, base: Trial, sensors: Path | None, wanted: tuple[ControlLaw, int, RunKind]
) -> RandomRun:
    """Run one of the random runs under one law; an object that is lost at once is a result too.

    wanted: law, number and kind of the run.
    """
    law, number, kind = wanted
    try:
        if kind is RunKind.LAW:
            return run_random(hand_toml, base, law, number)
        return run_random_in_chain(hand_toml, base, law, number, sensors if kind is RunKind.FRAMES else None)
    except LostGraspError:  # before the turn: nothing of the schedule has acted
        return RandomRun(law, number, 0.0, 0.0, 0.0, 0.0, 0, "lost while it was grasped", kind)


def kind_of(number: int, in_chain: bool, has_sensors: bool) -> RunKind:
    """Return which parts of the hand run in run `number`."""
    if not in_chain:
        return RunKind.LAW
    return RunKind.FRAMES if has_sensors and number % FRAMES_EVERY == 0 else RunKind.CHAIN


def run_all(
    hand_toml: Path,
    base: Trial,
    laws: Sequence[ControlLaw],
    count: int,
    jobs: int,
    done: Callable[[], None] = lambda: None,
    in_chain: bool = False,
    sensors: Path | None = None,
) -> list[RandomRun]:
    """Run `count` random runs under each law; order and results do not depend on `jobs`.

    in_chain: in the whole chain in place of the law alone. sensors: with it, one run of `FRAMES_EVERY` gets
    its contacts from frames of these (shake.make_sensors).
    """
    kinds = [kind_of(number, in_chain, sensors is not None) for number in range(count)]
    wanted = [(law, number, kind) for law in laws for number, kind in enumerate(kinds)]
    return run_each(partial(run_one, hand_toml, base, sensors), wanted, jobs, done)


def random_table(runs: Sequence[RandomRun]) -> str:
    """Return a Markdown table with a row for each law and kind of run, and a line for each dropped object."""
    lines = [
        "| law | runs | dropped | slid by 1 mm | slip mm: median | 95 % | largest | place mm: median"
        " | largest | largest normal force N | answered slips |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for row in dict.fromkeys(run.row for run in runs):
        own = [run for run in runs if run.row == row]
        kept = [run for run in own if run.lost_s is None]
        cells = [
            row,
            str(len(own)),
            str(len(own) - len(kept)),
            str(sum(bool(run.explanation) for run in own)),
        ]
        slips, ways = [run.slip_mm for run in kept], [run.moved_mm for run in kept]
        if kept:
            cells += [f"{np.quantile(slips, share):.2f}" for share in (0.5, 0.95, 1.0)]
            cells += [f"{np.quantile(ways, share):.1f}" for share in (0.5, 1.0)]
        else:
            cells += [""] * 5
        cells += [f"{max(run.normal_N for run in own):.1f}", str(sum(run.slips for run in own))]
        lines.append(f"| {' | '.join(cells)} |")
    dropped = [run for run in runs if run.lost_s is not None]
    lines += [""] * bool(dropped)
    for run in dropped:
        why = run.explanation or "no tip slid"
        lines.append(f"- {run.row}, run {run.number}: dropped at {run.lost_s:.2f} s; {why}")
    return "\n".join(lines)
