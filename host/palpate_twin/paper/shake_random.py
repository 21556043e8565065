"""Random handling of a held object: many runs, each with its own loads, friction, delay and lost contacts.

A run has a turn of up to 15 deg about any axis, a weight that the hand takes over, pushes, friction that
changes, one gap in the contacts of one finger, and one delay of all contacts. Number and seed determine it,
so that both laws meet the same runs. A drop is explained by what acted when the first tip began to slide.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.twin_config import DisturbanceConfig
from palpate_twin.paper.shake import lifted
from palpate_twin.paper.trial import run_trial
from palpate_twin.paper.trial_parameters import Gap, Trial

TURN_DEG = 15.0
PUSH_N, PUSH_S = (0.5, 3.0), (0.05, 0.3)
MOST_PUSHES = 3
FRICTION = (0.3, 1.0)
MASS_KG = (0.05, 0.3)
GAP_S, DELAY_S = (0.010, 0.5), (0.02, 0.2)


class RunKind(enum.Enum):
    """Parts of the hand that run: the law alone; the whole chain; the chain with rendered frames."""

    LAW = ""
    CHAIN = ", chain"
    FRAMES = ", chain, frames"


@dataclass(frozen=True, slots=True)
class RandomRun:
    """Figures of one run. explanation: what acted when a tip began to slide; empty when none slid by 1 mm."""

    law: ControlLaw
    number: int
    lost_s: float | None
    slip_mm: float
    moved_mm: float
    normal_N: float
    slips: int
    explanation: str
    kind: RunKind = RunKind.LAW

    @property
    def row(self) -> str:
        """The row of the table."""
        return f"{self.law.value}{self.kind.value}"


def random_trial(base: Trial, number: int) -> Trial:
    """Return run `number`; base has the seed, the noise and the duration."""
    rng = np.random.default_rng([base.seed, number])
    span_s = base.duration_s

    def between(limits: tuple[float, float]) -> float:
        return float(rng.uniform(*limits))

    def direction() -> Array:
        vector = rng.normal(size=3)
        return np.asarray(vector / np.linalg.norm(vector))

    turn = TURN_DEG * rng.uniform() * direction()
    loads = list(lifted(between(MASS_KG), between((0.0, 0.4 * span_s))))
    for _ in range(int(rng.integers(1, MOST_PUSHES + 1))):
        push = between(PUSH_N) * direction()
        loads.append(
            DisturbanceConfig(
                start_s=between((0.0, 0.8 * span_s)),
                duration_s=between(PUSH_S),
                force_N=(float(push[0]), float(push[1]), float(push[2])),
            )
        )
    for start_s in sorted(rng.uniform(0.1 * span_s, 0.9 * span_s, size=2).tolist()):
        loads.append(DisturbanceConfig(start_s=start_s, friction=between(FRICTION)))
    gap = Gap(int(rng.integers(3)), between((0.0, 0.8 * span_s)), between(GAP_S))
    return replace(
        base,
        rpy_deg=(float(turn[0]), float(turn[1]), float(turn[2])),
        friction=between((0.5, FRICTION[1])),
        disturbances=tuple(loads),
        gaps=(gap,),
        delay_s=between(DELAY_S),
        seed=base.seed + number,
    )


def explanation(trial: Trial, slid_s: float) -> str:
    """Return what acted on the object at the time at which a tip began to slide."""
    acting = [one for one in trial.disturbances if one.start_s <= slid_s < one.start_s + one.duration_s]
    force_N = float(np.linalg.norm(np.sum([one.force_N for one in acting] or [(0.0, 0.0, 0.0)], axis=0)))
    friction = [trial.friction] + [one.friction for one in acting if one.friction is not None]
    gaps = [gap for gap in trial.gaps if gap.contains(slid_s)]
    silent = "".join(f", finger-{gap.finger + 1} without contacts" for gap in gaps)
    return (
        f"slid from {slid_s:.2f} s: load {force_N:.1f} N, friction {friction[-1] or 0.0:.2f},"
        f" contacts {1e3 * trial.delay_s:.0f} ms late{silent}"
    )


def run_random(hand_toml: Path, base: Trial, law: ControlLaw, number: int) -> RandomRun:
    """Run one of the random runs with one law alone. Raises LostGraspError if it is lost before the turn."""
    trial = replace(random_trial(base, number), law=law)
    outcome = run_trial(hand_toml, "mujoco", trial)
    places = np.array([place for _, place in outcome.poses])
    return RandomRun(
        law=law,
        number=number,
        lost_s=outcome.lost_s,
        slip_mm=float(outcome.slip_mm.max()),
        moved_mm=1e3 * float(np.linalg.norm(places - places[0], axis=1).max()),
        normal_N=outcome.normal_N,
        slips=outcome.slips,
        explanation="" if outcome.slid_s is None else explanation(trial, outcome.slid_s),
    )
