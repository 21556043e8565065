"""Run the closed loop as an experiment: grasp, turn the object, and measure each part of the chain."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.service.host import load_hand
from palpate_twin.closed_loop.lockstep import LockstepLoop, LoopRecord, final_error_deg, turning_samples
from palpate_twin.closed_loop.tactile_rendering import ContactSource
from palpate_twin.hand.twin_model import TwinModel
from palpate_twin.paper.figure_data import AXES, STEP_DEG
from palpate_twin.paper.trial import make_engine

G_M_S2 = 9.81
POSITION_STIFFNESS_N_M = 300.0


@dataclass(frozen=True, slots=True)
class LoopResult:
    """Figures of one run.

    rpy_deg: (n, 3) rotation of the object since the host began to turn it. slip_mm: (3,) sliding distance of
    each tip. drop_mm: loss of height of the object since then. contact_error_mm: mean distance between
    published and true contacts. rejected: number of frames without a valid contact. film: MuJoCo's qpos every
    half second from the start.
    """

    axis: int
    error_deg: float
    rpy_deg: Array
    slip_mm: Array
    drop_mm: float
    contact_error_mm: float
    rejected: int
    frames: int
    bus_frames: int
    failure: str
    twin: TwinModel
    film: list[Array]


def run_loop(
    hand_toml: Path,
    axis: int,
    make_contact_source: Callable[[], ContactSource],
    *,
    seconds: float,
    friction: float | None,
    integral_per_s: float,
    engine: str,
    has_weight: bool = False,
) -> LoopResult:
    """Grasp and turn by 30 deg about one axis.

    friction: replaces the coefficient in hand.toml. has_weight: the object has weight, which the host knows
    and compensates.
    """
    config, hand = load_hand(hand_toml)
    rpy = [0.0, 0.0, 0.0]
    rpy[axis] = STEP_DEG
    turn = (rpy[0], rpy[1], rpy[2])
    config = msgspec.structs.replace(
        config,
        target=msgspec.structs.replace(config.target, rpy_deg=turn),
        control=msgspec.structs.replace(config.control, integral_per_s=integral_per_s),
    )
    if config.twin is not None and has_weight:
        control = msgspec.structs.replace(
            config.control,
            object_weight_N=G_M_S2 * config.twin.object.mass_kg,
            position_stiffness_N_m=POSITION_STIFFNESS_N_M,
        )
        config = msgspec.structs.replace(config, control=control)
    if config.twin is not None and friction is not None:
        tip = msgspec.structs.replace(config.twin.tip, friction=friction)
        config = msgspec.structs.replace(config, twin=msgspec.structs.replace(config.twin, tip=tip))
    loop = LockstepLoop(
        config, hand, make_engine(config, engine, has_B=False), make_contact_source(), has_weight
    )
    record = loop.run(seconds)
    error_deg, rpy_deg = final_error_deg(record, turn)
    errors_mm = contact_errors_mm(record)
    return LoopResult(
        axis=axis,
        error_deg=error_deg,
        rpy_deg=rpy_deg,
        slip_mm=1e3 * loop.engine.slip_m,
        drop_mm=1e3
        * float(turning_samples(record)[0].object_position_m[2] - loop.engine.object_position_m[2]),
        contact_error_mm=float(np.mean(errors_mm)) if errors_mm else math.nan,
        rejected=sum(not contact.valid for _, contact, _ in record.contacts),
        frames=len(record.contacts),
        bus_frames=record.bus_frames,
        failure=record.failure,
        twin=loop.engine.twin,
        film=record.film,
    )


def contact_errors_mm(record: LoopRecord) -> list[float]:
    """Return the distances between published and true contacts on the dome, where both exist."""
    return [
        math.dist(contact.position_mm, truth)
        for _, contact, truth in record.contacts
        if contact.position_mm is not None and truth is not None
    ]


def loop_table(results: Sequence[LoopResult]) -> str:
    """Return a Markdown table with a row per turn."""
    lines = [
        "| turn | error deg | roll, pitch, yaw deg | drop mm | slip of the tips mm | contact error mm |"
        " frames rejected | CAN frames |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for result in results:
        reached = ", ".join(f"{angle:.1f}" for angle in result.rpy_deg[-1])
        slip = ", ".join(f"{path:.2f}" for path in result.slip_mm)
        lines.append(
            f"| {AXES[result.axis]} {STEP_DEG:g} | {result.error_deg:.2f} | {reached} |"
            f" {result.drop_mm:.1f} | {slip} | {result.contact_error_mm:.2f} |"
            f" {result.rejected} of {result.frames} | {result.bus_frames} |"
        )
    return "\n".join(lines)
