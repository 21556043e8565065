"""Compute all figures of a demo run from its bus log, its configuration files and the recorded truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import HandConfig
from palpate_host.service.host import load_hand
from palpate_host.service.replay import read_hand_log
from palpate_twin.demo.hand_motion import (
    HandFigures,
    HostTick,
    JointTorque,
    hand_figures,
    joint_torques,
    recorded_modes,
    replay_modes,
)
from palpate_twin.demo.live_view import mode_name
from palpate_twin.demo.programme import read_commands
from palpate_twin.demo.run_folder import RunFolder
from palpate_twin.demo.traffic import Traffic, traffic
from palpate_twin.demo.truth import (
    FingerFigures,
    Pair,
    finger_figures,
    read_pairs,
    truth_of_recording,
    truth_of_twin,
)
from palpate_twin.demo.turn import TurnFigures, TurnSeries, analyse_turns
from palpate_twin.hand.motion import TrueMotion, read_motion
from palpate_twin.hand.push_recovery import PushStep, push_steps

SLOW_PACE = 0.9
"""Simulated over real time below which the hand is softer: at 0.82 pushes ended beyond their limit."""


@dataclass(frozen=True, slots=True)
class Summary:
    """Contents of summary.json.

    origin: header entries of the bus log. turn: None if a recording was played, or if the host never turned
    the object. pushes: of [[twin.disturbances]], as far as they ended in time.
    """

    started_at: str
    duration_s: float
    bitrate: int
    origin: Mapping[str, str]
    fingers: tuple[FingerFigures, ...]
    bus: Traffic
    hand: HandFigures
    turn: TurnFigures | None
    pushes: tuple[PushStep, ...] = ()


@dataclass(frozen=True, slots=True)
class Analysis:
    """Summary of a run and the time series it was computed from.

    begin_us: time stamp of the log's first frame. recording: folder of the recording that was played; None
    if the contacts came from the simulated hand, in which case motion and turn are known.
    """

    summary: Summary
    begin_us: int
    config: HandConfig
    recording: Path | None
    pairs: tuple[list[Pair], ...]
    ticks: list[HostTick]
    torques: list[JointTorque]
    motion: TrueMotion | None
    turn: TurnSeries | None


def analyse(folder: RunFolder) -> Analysis:
    """Analyse the run in a folder.

    Raises LogError, ConfigError or DatasetError if a file is missing, damaged or was recorded with a
    different EDS or hand.toml.
    """
    config, hand = load_hand(folder.hand_toml)
    log = read_hand_log(folder.log, config)
    if len(log.records) < 2:
        raise DatasetError(f"{folder.log}: contains fewer than two CAN frames: run the demo again")
    fingers, all_pairs = [], []
    recording = None
    for fingertip in folder.fingertips():
        if fingertip.capture.source == "shared_memory":
            truth = truth_of_twin(folder.truth / f"{fingertip.name}.csv")
        else:
            path = Path(fingertip.capture.path)
            recording = path.parent
            presses = read_dataset(path).presses
            if not presses:
                raise DatasetError(f"{path}/truth.csv: no such file: give a recording that has one")
            truth = truth_of_recording(presses)
        pairs, incomplete = read_pairs(log.records, fingertip.node.id, truth)
        all_pairs.append(pairs)
        fingers.append(finger_figures(fingertip.name, pairs, incomplete))
    begin_us = log.records[0].stamp_us
    sent = read_commands(folder.commands)
    ticks = recorded_modes(log.ticks) or replay_modes(log.records, config, hand, sent)
    torques = joint_torques(log.records, config)
    motion = None if recording is not None else read_motion(folder.motion)
    requests = [(begin_us, config.target.rpy_deg), *((s.after_us, s.rotate.rpy_deg) for s in sent)]
    turned = None if motion is None else analyse_turns(ticks, motion, begin_us, requests)
    turn, turn_figures = turned or (None, None)
    pushes = config.twin.disturbances if config.twin is not None else ()
    bus = traffic(log.records, config.bus.bitrate, config)
    summary = Summary(
        started_at=datetime.fromtimestamp(begin_us // 1_000_000, UTC).isoformat(),
        duration_s=bus.duration_s,
        bitrate=config.bus.bitrate,
        origin=log.header.entries,
        fingers=tuple(fingers),
        bus=bus,
        hand=hand_figures(ticks, torques, begin_us),
        turn=turn_figures,
        pushes=() if motion is None else push_steps(pushes, motion, begin_us),
    )
    return Analysis(summary, begin_us, config, recording, tuple(all_pairs), ticks, torques, motion, turn)


def write_summary(path: Path, summary: Summary) -> None:
    """Write the summary as JSON."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n", DatasetError)


def summary_lines(summary: Summary) -> list[str]:
    """Return the summary as lines of text for the terminal."""
    lines = [_finger_line(finger) for finger in summary.fingers]
    if summary.turn is not None:
        lines += [f"{step.name}: {step.outcome}" for step in summary.turn.steps]
        lines.append(_speed_line(summary.turn.pace))
    lines += [f"{push.name}: {push.outcome}" for push in summary.pushes]
    modes = ", ".join(f"{mode_name(Mode(mode))} {s:.1f} s" for mode, s in summary.hand.mode_s.items())
    over = sum(joint.over_limit for joint in summary.hand.joints)
    lines.append(f"bus load: {summary.bus.mean_percent:.1f} % mean, {summary.bus.peak_percent:.1f} % peak")
    lines.append(f"modes: {modes}")
    lines.append(f"torque commands above the limit: {over}")
    return lines


def _speed_line(pace: float) -> str:
    """Return the simulation speed, and the way out where it softens the hand."""
    line = f"simulation speed: {pace:.2f} of real time"
    if pace >= SLOW_PACE:
        return line
    return f"{line}: too slow for turns and pushes as exact as they are with palpate-host demo --lockstep"


def _finger_line(finger: FingerFigures) -> str:
    error, latency = finger.position_error_mm, finger.latency_us
    parts = [f"{finger.frames} frames, {finger.dropped} dropped, {finger.refused} rejected"]
    if finger.contact_right_percent is not None:
        parts.append(f"contact flag correct in {finger.contact_right_percent:.1f} %")
    if error is not None:
        parts.append(f"position error {error.mean:.2f} mm mean, {error.p95:.2f} mm p95")
    if finger.force_rmse_N is not None and finger.force_rmse_percent is not None:
        percent = f"{finger.force_rmse_percent:.1f} % of the largest force"
        parts.append(f"force RMSE {finger.force_rmse_N:.3f} N ({percent})")
    if latency is not None:
        median_ms, p99_ms = latency.median / 1000, latency.p99 / 1000
        parts.append(f"exposure to bus {median_ms:.1f} ms median, {p99_ms:.1f} ms p99")
    return f"{finger.name}: " + "; ".join(parts)
