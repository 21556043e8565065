"""The closed loop as an experiment: grasp, turn the object, and say how well each part of the chain did."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.service.host import load_hand
from palpate_twin.closed_loop.fingertip_feel import Feel
from palpate_twin.closed_loop.lockstep import LockstepLoop, LoopRecord, missing_turn_deg, turning_samples
from palpate_twin.hand.twin_model import TwinModel
from palpate_twin.paper.figure_data import AXES, STEP_DEG
from palpate_twin.paper.trial import make_engine

G_M_S2 = 9.81
POSITION_STIFFNESS_N_M = 300.0


@dataclass(frozen=True, slots=True)
class LoopResult:
    """rpy_deg (n, 3): the object's turn since the host began to turn it. refused: frames that the estimators
    did not believe. contact_error_mm: mean distance of published from true contacts. slip_mm: (3,). sunk_mm:
    how much lower the object ends than where turning began. film: the model's states (MuJoCo's qpos), every
    half second from the start."""

    axis: int
    error_deg: float
    rpy_deg: Array
    slip_mm: Array
    sunk_mm: float
    contact_error_mm: float
    refused: int
    frames: int
    bus_frames: int
    failure: str
    twin: TwinModel
    film: list[Array]


def run_loop(
    hand_toml: Path,
    axis: int,
    make_feel: Callable[[], Feel],
    *,
    seconds: float,
    friction: float | None,
    integral_per_s: float,
    engine: str,
    has_weight: bool = False,
) -> LoopResult:
    """Grasp and turn by 30 degrees about one axis. friction: in place of the hand's own. has_weight: the host
    carries the object, whose weight it knows."""
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
    loop = LockstepLoop(config, hand, make_engine(config, engine, has_B=False), make_feel(), has_weight)
    record = loop.run(seconds)
    error_deg, rpy_deg = missing_turn_deg(record, turn)
    errors_mm = contact_errors_mm(record)
    return LoopResult(
        axis=axis,
        error_deg=error_deg,
        rpy_deg=rpy_deg,
        slip_mm=1e3 * loop.engine.slip_m,
        sunk_mm=1e3
        * float(turning_samples(record)[0].object_position_m[2] - loop.engine.object_position_m[2]),
        contact_error_mm=float(np.mean(errors_mm)) if errors_mm else math.nan,
        refused=sum(not contact.valid for _, contact, _ in record.contacts),
        frames=len(record.contacts),
        bus_frames=record.bus_frames,
        failure=record.failure,
        twin=loop.engine.twin,
        film=record.film,
    )


def contact_errors_mm(record: LoopRecord) -> list[float]:
    """Distances of published contacts from the true ones, on the dome, where both say contact."""
    return [
        math.dist(contact.position_mm, truth)
        for _, contact, truth in record.contacts
        if contact.position_mm is not None and truth is not None
    ]


def loop_table(results: Sequence[LoopResult]) -> str:
    """Markdown, a row for each turn."""
    lines = [
        "| turn | error deg | roll, pitch, yaw deg | sunk mm | slip of the tips mm | contact error mm |"
        " frames refused | bus frames |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for result in results:
        reached = ", ".join(f"{angle:.1f}" for angle in result.rpy_deg[-1])
        slip = ", ".join(f"{path:.2f}" for path in result.slip_mm)
        lines.append(
            f"| {AXES[result.axis]} {STEP_DEG:g} | {result.error_deg:.2f} | {reached} |"
            f" {result.sunk_mm:.1f} | {slip} | {result.contact_error_mm:.2f} |"
            f" {result.refused} of {result.frames} | {result.bus_frames} |"
        )
    return "\n".join(lines)
