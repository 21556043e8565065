"""All figures of a run, from its bus log, its configuration files and the truth alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from palpate_bus.logs.candump import read_log
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import HandConfig
from palpate_host.service.host import load_hand
from palpate_host.service.replay import check_contract
from palpate_twin.demo.hand_motion import (
    HandFigures,
    JointTorque,
    Moment,
    hand_figures,
    joint_torques,
    replay_modes,
)
from palpate_twin.demo.live_view import mode_name
from palpate_twin.demo.programme import read_given
from palpate_twin.demo.run_folder import RunFolder
from palpate_twin.demo.traffic import Traffic, traffic
from palpate_twin.demo.truth import (
    FingerFigures,
    Pair,
    finger_figures,
    of_recording,
    of_twin,
    read_pairs,
)
from palpate_twin.demo.turn import Turn, TurnFigures, turn_of
from palpate_twin.hand.motion import TrueMotion, read_motion


@dataclass(frozen=True, slots=True)
class Summary:
    """What summary.json holds. origin: the lines of the log's header. turn: None without the twin, or when
    the object was never turned."""

    started_at: str
    duration_s: float
    bitrate: int
    origin: Mapping[str, str]
    fingers: tuple[FingerFigures, ...]
    bus: Traffic
    hand: HandFigures
    turn: TurnFigures | None


@dataclass(frozen=True, slots=True)
class Analysis:
    """The summary and the series behind it. begin_us: stamp of the log's first frame. recording: its folder;
    None with the twin, whose motion and turn are then known."""

    summary: Summary
    begin_us: int
    config: HandConfig
    recording: Path | None
    pairs: tuple[list[Pair], ...]
    moments: list[Moment]
    torques: list[JointTorque]
    motion: TrueMotion | None
    turn: Turn | None


def analyse(folder: RunFolder) -> Analysis:
    """Read a run folder.

    Raises LogError, ConfigError or DatasetError for what is missing, damaged or of another contract.
    """
    config, hand = load_hand(folder.hand_toml)
    log = read_log(folder.log)
    check_contract(folder.log, log.header, config)
    if len(log.records) < 2:
        raise DatasetError(f"{folder.log}: holds no traffic: run the demo again")
    fingers, all_pairs = [], []
    recording = None
    for fingertip in folder.fingertips():
        if fingertip.capture.source == "shared_memory":
            truth = of_twin(folder.truth / f"{fingertip.name}.csv")
        else:
            path = Path(fingertip.capture.path)
            recording = path.parent
            presses = read_dataset(path).presses
            if not presses:
                raise DatasetError(f"{path}: has no truth.csv: use a recording with its truth")
            truth = of_recording(presses)
        pairs, incomplete = read_pairs(log.records, fingertip.node.id, truth)
        all_pairs.append(pairs)
        fingers.append(finger_figures(fingertip.name, pairs, incomplete))
    begin_us = log.records[0].stamp_us
    given = read_given(folder.commands)
    moments = replay_modes(log.records, config, hand, given)
    torques = joint_torques(log.records, config)
    motion = None if recording is not None else read_motion(folder.motion)
    asked = [(begin_us, config.target.rpy_deg), *((g.after_us, g.rotate.rpy_deg) for g in given)]
    turned = None if motion is None else turn_of(moments, motion, begin_us, asked)
    turn, turn_figures = turned or (None, None)
    bus = traffic(log.records, config.bus.bitrate, config)
    summary = Summary(
        started_at=datetime.fromtimestamp(begin_us // 1_000_000, UTC).isoformat(),
        duration_s=bus.duration_s,
        bitrate=config.bus.bitrate,
        origin=log.header.entries,
        fingers=tuple(fingers),
        bus=bus,
        hand=hand_figures(moments, torques, begin_us),
        turn=turn_figures,
    )
    return Analysis(summary, begin_us, config, recording, tuple(all_pairs), moments, torques, motion, turn)


def write_summary(path: Path, summary: Summary) -> None:
    """Write summary.json."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n")


def summary_lines(summary: Summary) -> list[str]:
    """The short summary for the terminal."""
    lines = []
    for finger in summary.fingers:
        error, latency = finger.position_error_mm, finger.latency_us
        parts = [f"{finger.frames} frames, {finger.dropped} dropped, {finger.refused} refused"]
        if finger.contact_right_percent is not None:
            parts.append(f"contact flag right {finger.contact_right_percent:.1f} %")
        if error is not None:
            parts.append(f"position error mean {error.mean:.2f} mm, p95 {error.p95:.2f}")
        if finger.force_rmse_N is not None and finger.force_rmse_percent is not None:
            parts.append(f"force RMSE {finger.force_rmse_N:.3f} N ({finger.force_rmse_percent:.1f} %)")
        if latency is not None:
            parts.append(f"to bus {latency.median / 1000:.1f} ms median, {latency.p99 / 1000:.1f} p99")
        lines.append(f"{finger.name}: " + "; ".join(parts))
    for step in summary.turn.steps if summary.turn is not None else ():
        asked = ", ".join(f"{angle:g}" for angle in step.rpy_deg)
        slip = ", ".join(f"{path:.2f}" for path in step.slip_mm)
        lines.append(
            f"turned by roll, pitch, yaw {asked} deg: {step.error_deg:.2f} deg off; tips slid by {slip} mm"
            + (f": {step.verdict}" if step.verdict else "")
        )
    if summary.turn is not None:
        lines.append(f"the hand's time went at {summary.turn.pace:.2f} of the machine's")
    modes = ", ".join(f"{mode_name(Mode(mode))} {s:.1f} s" for mode, s in summary.hand.mode_s.items())
    over = sum(joint.over_limit for joint in summary.hand.joints)
    lines.append(f"bus load {summary.bus.mean_percent:.1f} % mean, {summary.bus.peak_percent:.1f} % peak")
    lines.append(f"modes: {modes}; torque commands over the limit: {over}")
    return lines
