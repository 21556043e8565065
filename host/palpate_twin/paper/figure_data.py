"""Data of the paper's Figs. 17 (simulation) and 20 (experiment): all turns, laws and engines."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.config import hand_reader
from palpate_host.config.control_config import ControlMode
from palpate_twin.closed_loop.external_camera import MarkerTruth, camera_above
from palpate_twin.paper.parallel_runs import run_each
from palpate_twin.paper.trial import RECORD_S, Outcome, run_trial
from palpate_twin.paper.trial_parameters import Trial

STEP_DEG = 30.0
AXES = ("roll", "pitch", "yaw")
INTEGRAL_PER_S = 3.0
MARKER_EVERY = 10  # recorded poses per picture of the external camera: 5 pictures a second


class Law(enum.Enum):
    """Controller that turns the object."""

    PROPOSED = "proposed"
    BLIND = "blind"
    INTEGRAL = "integral"

    def trial(self, axis: int, duration_s: float, noise_mm: float, seed: int) -> Trial:
        """Return the trial of a 30 deg turn about one axis under this law, with contacts delayed by 50 ms."""
        rpy = [0.0, 0.0, 0.0]
        rpy[axis] = STEP_DEG
        return Trial(
            mode=ControlMode.BLIND if self is Law.BLIND else ControlMode.PROPOSED,
            rpy_deg=(rpy[0], rpy[1], rpy[2]),
            duration_s=duration_s,
            noise_mm=noise_mm,
            integral_per_s=INTEGRAL_PER_S if self is Law.INTEGRAL else 0.0,
            seed=seed,
        )


@dataclass(frozen=True, slots=True)
class FigureCase:
    """One run of the study. by_marker: the object's turn is also measured by an external camera."""

    hand_toml: Path
    engine: str
    law: Law
    axis: int
    duration_s: float
    noise_mm: float
    seed: int
    by_marker: bool
    friction: float | None = None


@dataclass(frozen=True, slots=True)
class Result:
    """A case and its outcome. marker_rpy_deg (m, 3) at marker_s (m,): measured by the external camera."""

    case: FigureCase
    outcome: Outcome
    marker_s: Array
    marker_rpy_deg: Array
    marker_error_deg: float | None


def all_cases(
    hand_toml: Path,
    engines: Sequence[str],
    duration_s: float,
    noise_mm: float,
    seed: int,
    by_marker: bool,
    friction: float | None = None,
) -> list[FigureCase]:
    """Return the cases of all axes, laws and engines. friction: replaces the coefficient in hand.toml."""
    return [
        FigureCase(hand_toml, engine, law, axis, duration_s, noise_mm, seed, by_marker, friction)
        for engine in engines
        for axis in range(3)
        for law in Law
    ]


def run_all(cases: Sequence[FigureCase], jobs: int, done: Callable[[], None]) -> list[Result]:
    """Run all cases, `jobs` at a time; order and results do not depend on `jobs`."""
    return run_each(run_case, cases, jobs, done)


def run_case(case: FigureCase) -> Result:
    """Run one simulation and measure it with the external camera if the case asks for it."""
    trial = case.law.trial(case.axis, case.duration_s, case.noise_mm, case.seed)
    trial = replace(trial, friction=case.friction)
    outcome = run_trial(case.hand_toml, case.engine, trial)
    if not case.by_marker:
        return Result(case, outcome, np.zeros(0), np.zeros((0, 3)), None)
    times, turns = _measured_by_camera(case, outcome)
    goal = rotation.from_rpy_deg(*trial.rpy_deg)
    rpy = np.array([rotation.to_rpy_deg(turn) for turn in turns])
    return Result(case, outcome, times, rpy, rotation.angle_deg(goal @ turns[-1].T))


def _measured_by_camera(case: FigureCase, outcome: Outcome) -> tuple[Array, list[Array]]:
    """Return times and the object's rotations since the first picture, measured on pictures of its marker."""
    twin = hand_reader.load(case.hand_toml).twin
    assert twin is not None  # the trial ran
    camera = camera_above(np.array(twin.object.position_m), twin.object.length_m)
    truth, rng = MarkerTruth(camera), np.random.default_rng(case.seed)
    times, turns = [], []
    start: Array | None = None
    last = len(outcome.poses) - 1
    for index in sorted({*range(0, len(outcome.poses), MARKER_EVERY), last}):
        turn, place_m = outcome.poses[index]
        R = truth.object_rotation(camera.picture(turn, place_m, rng))
        if R is None:
            continue
        start = R if start is None else start
        times.append(index * RECORD_S)
        turns.append(R @ start.T)
    return np.array(times), turns


def _error(outcome: Outcome) -> str:
    lost = "" if outcome.lost_s is None else f" (lost after {outcome.lost_s:.1f} s)"
    return f"{outcome.error_deg:.2f}{lost}"


def engines_apart_deg(results: Sequence[Result]) -> list[tuple[str, int, Law, float, float]]:
    """Compare the engines: hand, axis, law, final and largest angle between the two objects.

    Cases in which one engine lost the object are left out.
    """
    runs = {(r.case.hand_toml.stem, r.case.axis, r.case.law, r.case.engine): r.outcome for r in results}
    apart = []
    for (hand, axis, law, engine), one in runs.items():
        other = runs.get((hand, axis, law, "mujoco"))
        if engine != "eqs" or other is None or one.lost_s is not None or other.lost_s is not None:
            continue
        angles = [
            rotation.angle_deg((R @ one.poses[0][0].T) @ (Q @ other.poses[0][0].T).T)
            for (R, _), (Q, _) in zip(one.poses, other.poses, strict=True)
        ]
        apart.append((hand, axis, law, angles[-1], max(angles)))
    return apart


def engines_table(results: Sequence[Result]) -> str:
    """Return `engines_apart_deg` as a Markdown table; empty if only one engine was run."""
    rows = [
        f"| {hand} | {AXES[axis]} {STEP_DEG:g} | {law.value} | {end:.2f} | {largest:.2f} |"
        for hand, axis, law, end, largest in engines_apart_deg(results)
    ]
    head = [
        "| hand | turn | law | engines apart at the end deg | at most deg |",
        "|---|---|---|---:|---:|",
    ]
    return "\n".join([*head, *rows]) if rows else ""


def table(results: Sequence[Result]) -> str:
    """Return a Markdown table: a row per engine and axis, with the final error under each law."""
    lines = [
        "| hand | engine | turn | proposed deg | blind deg | integral deg | marker: proposed, blind deg"
        " | friction/normal | slip mm | energy error |",
        "|---|---|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    cases = {(r.case.hand_toml.stem, r.case.engine, r.case.axis): r for r in results}
    for hand, engine, axis in cases:
        by_law = {
            r.case.law: r
            for r in results
            if (r.case.hand_toml.stem, r.case.engine, r.case.axis) == (hand, engine, axis)
        }
        proposed = by_law[Law.PROPOSED].outcome
        errors = [_error(by_law[law].outcome) for law in Law]
        measured = [by_law[law].marker_error_deg for law in (Law.PROPOSED, Law.BLIND)]
        energy = "" if proposed.energy_error is None else f"{abs(proposed.energy_error):.0e}"
        lines.append(
            f"| {hand} | {engine} | {AXES[axis]} {STEP_DEG:g} | {errors[0]} | {errors[1]} | {errors[2]} | "
            f"{', '.join(f'{error:.2f}' for error in measured if error is not None)} | "
            f"{proposed.friction_ratio:.2f} | {proposed.slip_mm.max():.3f} | {energy} |"
        )
    return "\n".join(lines)
