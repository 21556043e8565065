"""Pushes, steady forces, weight and turns: how well a held object keeps its pose under a law.

A case runs either with the law alone, 1000 times a second (trial.py), or in the whole chain of host core,
CAN bus, fingertip nodes and drives at the hand's own tick rate. Contacts are the true ones with noise; in
the whole chain they may be estimated from rendered frames instead.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.command import Move
from palpate_host.common.easing import eased
from palpate_host.common.mode import Mode
from palpate_host.config import hand_reader
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.hand_config import HandConfig
from palpate_host.config.twin_config import DisturbanceConfig
from palpate_host.service.host import load_hand
from palpate_twin.closed_loop.fingertip_sensors import fingertip_sensors
from palpate_twin.closed_loop.lockstep import LockstepLoop, final_error_deg, turning_samples
from palpate_twin.closed_loop.tactile_rendering import ContactSource, RenderedContactSource
from palpate_twin.dome.library import load_library
from palpate_twin.paper.figure_data import AXES, STEP_DEG
from palpate_twin.paper.parallel_runs import run_each
from palpate_twin.paper.trial import make_engine, run_trial, trial_contacts
from palpate_twin.paper.trial_parameters import Trial, after, trial_config, with_disturbances

FIRST_S = 1.0
"""Time from the start of the trial to the disturbance."""
PUSH_S = 0.2
RECOVERY_S = 1.0
PUSHES_N = (0.5, 2.0, 3.0, 5.0)
STEADY_N = (0.5, 1.0)
LIFTED_KG = (0.05, 0.1, 0.2, 0.3)
MOVED_MM = 10.0
LIFT_S, LIFT_STEPS, GRAVITY_M_S2 = 1.0, 50, 9.81
SLIPPING_N, LESS_FRICTION = 3.0, 0.3
CHAIN_START_S = 1.0
"""Time in the whole chain from the start to the trial's: by then the host holds the object."""
LOST_M = 0.2
"""Distance at which an object has left the hand."""
DOWN = (0.0, 0.0, -1.0)


@dataclass(frozen=True, slots=True)
class ShakeCase:
    """One run. name: the row of the table; runs of one name differ in the force's direction."""

    name: str
    trial: Trial
    is_push: bool = False


@dataclass(frozen=True, slots=True)
class Held:
    """Figures of one run.

    error_deg: final angle between true and desired orientation. moved_mm: distance of the object from its
    place at the start, or from where a move leads it: largest, RECOVERY_S after the end of a push (None
    without one), and final. slip_mm: longest path of a tip on the object. lost_s: time at which the object
    was lost.
    """

    name: str
    error_deg: float
    moved_most_mm: float
    moved_later_mm: float | None
    moved_last_mm: float
    slip_mm: float
    lost_s: float | None


def directions(count: int) -> list[tuple[float, float, float]]:
    """Return unit vectors: down, the 6 along the axes, or the 26 to the neighbours in a cube."""
    if count == 1:
        return [DOWN]
    cube = [np.array(steps, dtype=float) for steps in itertools.product((-1, 0, 1), repeat=3) if any(steps)]
    chosen = [steps / np.linalg.norm(steps) for steps in cube if count == 26 or np.abs(steps).sum() == 1.0]
    return [(float(x), float(y), float(z)) for x, y, z in chosen]


def shake_cases(base: Trial, direction_count: int) -> list[ShakeCase]:
    """Return the runs of the table: pushes and steady forces in each direction, weight, turns, moves, slip.

    The pose law alone moves an object. base: the law, noise, friction and duration of all runs.
    """
    cases = []
    for force_N in PUSHES_N:
        cases += [
            _forced(base, f"push {force_N:g} N for {PUSH_S:g} s", force_N, along, PUSH_S)
            for along in directions(direction_count)
        ]
    for force_N in STEADY_N:
        cases += [
            _forced(base, f"steady {force_N:g} N", force_N, along, None)
            for along in directions(direction_count)
        ]
    cases.append(ShakeCase("own weight", replace(base, has_weight=True)))
    cases += [
        ShakeCase(
            f"lift {mass_kg:g} kg in {LIFT_S:g} s", replace(base, disturbances=lifted(mass_kg, FIRST_S))
        )
        for mass_kg in LIFTED_KG
    ]
    for axis, name in enumerate(AXES):
        turn = STEP_DEG * np.eye(3)[axis]
        rpy_deg = (float(turn[0]), float(turn[1]), float(turn[2]))
        cases.append(ShakeCase(f"{name} {STEP_DEG:g} deg", replace(base, rpy_deg=rpy_deg)))
    if base.law is ControlLaw.POSE:
        x, y, z = MOVED_MM, 0.0, 0.0
        for along in "xyz":
            cases.append(ShakeCase(f"move {MOVED_MM:g} mm along {along}", replace(base, xyz_mm=(x, y, z))))
            x, y, z = z, x, y
    return cases + slip_cases(base)


def lifted(mass_kg: float, start_s: float) -> tuple[DisturbanceConfig, ...]:
    """Return the weight of a mass that the hand takes over from a table, evenly within `LIFT_S`."""
    part_N = GRAVITY_M_S2 * mass_kg / LIFT_STEPS
    return tuple(
        DisturbanceConfig(start_s=start_s + LIFT_S * step / LIFT_STEPS, force_N=(0.0, 0.0, -part_N))
        for step in range(LIFT_STEPS)
    )


def slip_cases(base: Trial) -> list[ShakeCase]:
    """Return the runs in which friction falls to `LESS_FRICTION`: under a steady force, and in a turn."""
    less = DisturbanceConfig(start_s=FIRST_S, friction=LESS_FRICTION)
    steady = DisturbanceConfig(start_s=0.5 * FIRST_S, force_N=(0.0, 0.0, -SLIPPING_N))
    falls = f"friction falls to {LESS_FRICTION:g}"
    return [
        ShakeCase(f"{falls} under {SLIPPING_N:g} N", replace(base, disturbances=(steady, less))),
        ShakeCase(
            f"{falls} at pitch {STEP_DEG:g} deg",
            replace(base, rpy_deg=(0.0, STEP_DEG, 0.0), disturbances=(less,)),
        ),
    ]


def _forced(
    base: Trial, name: str, force_N: float, along: tuple[float, float, float], duration_s: float | None
) -> ShakeCase:
    x, y, z = along
    force = (force_N * x, force_N * y, force_N * z)
    one = DisturbanceConfig(start_s=FIRST_S, force_N=force)
    if duration_s is not None:
        one = DisturbanceConfig(start_s=FIRST_S, duration_s=duration_s, force_N=force)
    return ShakeCase(name, replace(base, disturbances=(one,)), duration_s is not None)


def run_shakes(
    hand_toml: Path,
    cases: Sequence[ShakeCase],
    in_chain: bool,
    jobs: int,
    done: Callable[[], None],
    sensors: Path | None = None,
) -> list[Held]:
    """Run all cases in MuJoCo, `jobs` at a time; order and results do not depend on `jobs`.

    sensors: as for `run_in_chain`.
    """
    run = partial(run_in_chain, hand_toml, sensors=sensors) if in_chain else partial(run_shake, hand_toml)
    return run_each(run, cases, jobs, done)


def run_shake(hand_toml: Path, case: ShakeCase) -> Held:
    """Run one case with the law alone. Raises LostGraspError if the object is lost before it begins."""
    outcome = run_trial(hand_toml, "mujoco", case.trial)
    places = np.array([place for _, place in outcome.poses])
    slip_mm = float(outcome.slip_mm.max())
    ramp_s = hand_reader.load(hand_toml).target.ramp_s
    return held(case, ramp_s, outcome.time_s, places, outcome.error_deg, slip_mm, outcome.lost_s)


def run_in_chain(hand_toml: Path, case: ShakeCase, sensors: Path | None = None) -> Held:
    """Run one case in the whole chain. Raises LostGraspError if the object was never held.

    sensors: the folder of the simulated fingertip sensors, made by `make_sensors`, whose frames are rendered;
    None: true contacts with noise.
    """
    trial = case.trial
    loaded, hand = load_hand(hand_toml)
    config = trial_config(loaded, trial)
    config = with_disturbances(config, after(trial.disturbances, CHAIN_START_S))
    contacts = chain_contacts(config, trial, sensors)
    engine = make_engine(config, "mujoco", has_B=False)
    loop = LockstepLoop(config, hand, engine, contacts, trial.has_weight)
    loop.run(CHAIN_START_S)
    slip_m = engine.slip_m.copy()
    if any(trial.xyz_mm):
        loop.run_until(lambda status: status.mode is Mode.MANIPULATE, RECOVERY_S)
        loop.host.command(Move(trial.xyz_mm))
    record = loop.run(trial.duration_s)
    turning = turning_samples(record)
    times = np.array([sample.time_s - CHAIN_START_S for sample in turning])
    places = np.array([sample.object_position_m for sample in turning])
    is_lost = times[np.linalg.norm(places - places[0], axis=1) > LOST_M]
    error_deg, _ = final_error_deg(record, trial.rpy_deg)
    slip_mm = 1e3 * float((engine.slip_m - slip_m).max())
    lost_s = float(is_lost[0]) if len(is_lost) else None
    return held(case, config.target.ramp_s, times, places, error_deg, slip_mm, lost_s)


def make_sensors(
    folder: Path, config: HandConfig, seed: int, done: Callable[[str], None]
) -> RenderedContactSource:
    """Return contacts of a simulated sensor for each finger, made and calibrated unless the folder has it.

    done: called with a text before each step. Raises ConfigError as `fingertip_sensors`.
    """
    names, library = [finger.name for finger in config.fingers], load_library()
    found = fingertip_sensors(folder, names, 1e3 * config.control.tip_radius_m, seed, library, done)
    return RenderedContactSource(found, library, seed)


def chain_contacts(config: HandConfig, trial: Trial, sensors: Path | None) -> ContactSource:
    """Return the true contacts with the trial's noise, or those estimated from the sensors' frames."""
    if sensors is None:
        return trial_contacts(config, trial)
    return make_sensors(sensors, config, trial.seed, lambda _text: None)


def held(
    case: ShakeCase,
    ramp_s: float,
    time_s: Array,
    place_m: Array,
    error_deg: float,
    slip_mm: float,
    lost_s: float | None,
) -> Held:
    """Return the figures of one run from times (n,) and places (n, 3).

    The first place is the target; a move leads it away within ramp_s.
    """
    passed = np.clip((time_s - time_s[0]) / ramp_s, 0.0, 1.0) if ramp_s > 0.0 else np.ones(len(time_s))
    target_m = place_m[0] + eased(passed)[:, None] * 1e-3 * np.array(case.trial.xyz_mm)
    moved_mm = 1e3 * np.linalg.norm(place_m - target_m, axis=1)
    later = int(np.searchsorted(time_s, FIRST_S + PUSH_S + RECOVERY_S - 1e-6))
    has_later = case.is_push and later < len(moved_mm)
    return Held(
        name=case.name,
        error_deg=error_deg,
        moved_most_mm=float(moved_mm.max()),
        moved_later_mm=float(moved_mm[later]) if has_later else None,
        moved_last_mm=float(moved_mm[-1]),
        slip_mm=slip_mm,
        lost_s=lost_s,
    )


def shake_table(results: Sequence[Held]) -> str:
    """Return a Markdown table with a row per name: the largest values of the runs that kept the object, the
    longest slip of all, and how many lost it."""
    lines = [
        "| what | orientation deg | place mm: most | 1 s after the push | at the end | slip mm | lost |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name in dict.fromkeys(result.name for result in results):
        runs = [result for result in results if result.name == name]
        kept = [run for run in runs if run.lost_s is None]
        lost = len(runs) - len(kept)
        cells = [
            name,
            _largest([run.error_deg for run in kept], 2),
            _largest([run.moved_most_mm for run in kept], 1),
            _largest([run.moved_later_mm for run in kept if run.moved_later_mm is not None], 1),
            _largest([run.moved_last_mm for run in kept], 1),
            _largest([run.slip_mm for run in runs], 2),
            f"{lost} of {len(runs)}" if lost else "",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _largest(values: Sequence[float], digits: int) -> str:
    """Return the largest of the values, empty without any."""
    return f"{max(values):.{digits}f}" if values else ""
