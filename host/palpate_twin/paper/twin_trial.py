"""One trial of an experiment on the simulated hand in lock step, with the real host, nodes and drives.

The object's rotation is measured as in the paper, by an external camera, which is simulated. The true
rotation is returned as well.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from palpate_bus.logs.candump import LogRecord, write_log
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.arrays import Array
from palpate_edge.common.atomic_write import make_folder
from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.experiment.protocol import ExperimentConfig, TrialCase
from palpate_host.experiment.result import TrialResult
from palpate_host.recording.mcap import McapRecording
from palpate_host.service.contract import recording_header
from palpate_host.service.host import load_hand
from palpate_host.service.host_records import HostRecorder
from palpate_twin.closed_loop.external_camera import MarkerTruth, camera_above
from palpate_twin.closed_loop.lockstep import LockstepLoop, Sample, turning_samples
from palpate_twin.closed_loop.tactile_rendering import ContactSource, TrueContactSource
from palpate_twin.hand.engine import Engine
from palpate_twin.paper.trial import make_engine

PICTURES_HZ = 5.0


class RecordedLoop(LockstepLoop):
    """The closed loop in lock step with a bus log and the host's statuses."""

    def __init__(
        self, config: HandConfig, hand: HandKinematics, engine: Engine, contacts: ContactSource
    ) -> None:
        super().__init__(config, hand, engine, contacts, on_tick=self._keep)
        self.bus_log: list[LogRecord] = []
        self.statuses: list[HostStatus] = []

    def _keep(self, status: HostStatus) -> None:
        self.statuses.append(status)

    def _send(self, now_us: int, frames: Sequence[CanFrame], from_host: bool) -> None:
        before = len(self._wire)
        super()._send(now_us, frames, from_host)
        on_wire = itertools.islice(self._wire, before, None)
        self.bus_log += [LogRecord(stamp_us, frame) for stamp_us, frame, _ in on_wire]


def trial_config(config: HandConfig, case: TrialCase, experiment: ExperimentConfig) -> HandConfig:
    """Return the configuration of this trial. Raises ConfigError if hand.toml has no [twin]."""
    if config.twin is None:
        raise ConfigError(
            f"{experiment.hand} has no [twin] section: add one with start_pose_rad and the object"
        )
    position_m = np.array(config.twin.object.position_m) + 1e-3 * np.array(case.pose.offset_mm)
    grasped = msgspec.structs.replace(config.twin.object, position_m=tuple(position_m.tolist()))
    return msgspec.structs.replace(
        config,
        twin=msgspec.structs.replace(config.twin, object=grasped),
        target=msgspec.structs.replace(config.target, rpy_deg=case.turn.rpy_deg),
        control=msgspec.structs.replace(
            config.control,
            mode=case.law,
            integral_per_s=experiment.integral_per_s,
            settle_ms=round(1000 * experiment.settle_s),
        ),
    )


def run_twin_trial(
    hand_toml: Path, experiment: ExperimentConfig, case: TrialCase, folder: Path
) -> TrialResult:
    """Run a trial and write bus.log and hand.mcap into `folder`. The same arguments give the same bits.

    Raises LostGraspError if the object is lost or never turned.
    """
    loaded, hand = load_hand(hand_toml)
    config = trial_config(loaded, case, experiment)
    engine = make_engine(config, experiment.engine, has_B=False)
    contacts = TrueContactSource(1e3 * config.control.tip_radius_m, experiment.noise_mm, experiment.seed)
    loop = RecordedLoop(config, hand, engine, contacts)
    record = loop.run(experiment.settle_s + experiment.seconds + 1.0)
    turning = turning_samples(record)
    make_folder(folder, ConfigError)
    records = sorted(loop.bus_log, key=lambda one: one.stamp_us)
    recorder = HostRecorder(config)
    notes = [note for status in loop.statuses for note in recorder.notes(status)]
    write_log(folder / "bus.log", recording_header(config), records, notes)
    _write_mcap(folder / "hand.mcap", loop.statuses, config, hand)
    times, turns = _by_camera(config, turning, experiment.seed)
    start = turning[0].object_rotation
    return TrialResult(
        case=case,
        folder=folder,
        time_s=times,
        turn=turns,
        true_turn=[sample.object_rotation @ start.T for sample in turning],
        slip_mm=1e3 * engine.slip_m,
        pictures=len(times),
        failure=record.failure,
    )


def _by_camera(config: HandConfig, turning: Sequence[Sample], seed: int) -> tuple[Array, list[Array]]:
    """Return times and rotations since the first picture, from five pictures a second and the last one."""
    assert config.twin is not None
    grasped = config.twin.object
    camera = camera_above(np.array(grasped.position_m), grasped.length_m)
    truth, rng = MarkerTruth(camera), np.random.default_rng(seed)
    every = max(1, round(len(turning) / (turning[-1].time_s - turning[0].time_s) / PICTURES_HZ))
    times: list[float] = []
    turns: list[Array] = []
    start: Array | None = None
    for sample in [*turning[:-1:every], turning[-1]]:
        R = truth.object_rotation(camera.picture(sample.object_rotation, sample.object_position_m, rng))
        if R is None:
            continue
        start = R if start is None else start
        times.append(sample.time_s - turning[0].time_s)
        turns.append(np.asarray(R @ start.T))
    if not turns:
        raise ConfigError(
            "the marker is in no picture of the external camera: move the object's start position into view"
        )
    return np.array(times), turns


def _write_mcap(path: Path, statuses: Sequence[HostStatus], config: HandConfig, hand: HandKinematics) -> None:
    with McapRecording(path, hand, [finger.name for finger in config.fingers]) as recording:
        for status in statuses:
            recording.write(status)
