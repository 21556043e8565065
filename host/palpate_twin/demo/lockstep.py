"""The demo in lock step: the same hand, turns, bus log and truth, in one process on simulated time.

Hand, rendered frames, estimators, nodes, drives and host core are those of the real-time demo
(`closed_loop/lockstep.py`). There is no hub, no other process and no shared memory, so the result does not
depend on the speed of the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack

from palpate_bus.logs.candump import LogHeader, LogRecord, LogWriter
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.arrays import Image
from palpate_edge.common.signals import stop_event
from palpate_host.common.command import Rotate
from palpate_host.common.mode import STARTING
from palpate_host.common.status import HostStatus
from palpate_host.service.host import load_hand
from palpate_host.service.host_records import HostRecorder
from palpate_twin.camera.frame_truth import FrameTruth, FrameTruthFile
from palpate_twin.camera.kept_pictures import PictureKeeper
from palpate_twin.closed_loop.fingertip_sensors import fingertip_sensors
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import RenderedContactSource
from palpate_twin.demo.monitor import MonitorSample
from palpate_twin.demo.orchestrator import DemoInterruptedError, ShowSample, log_header
from palpate_twin.demo.programme import Programme
from palpate_twin.demo.run_folder import RunFolder, bind_calibrations
from palpate_twin.dome.library import load_library
from palpate_twin.hand.motion import PERIOD_US, MotionFile
from palpate_twin.paper.trial import make_engine

ORIGIN = "palpate demo --lockstep"
START_TIMEOUT_S, STOP_TIMEOUT_S = 5.0, 3.0
"""Simulated time within which the hand has to operate, and to stop."""
POLL_PERIOD_S = 0.01
SHOW_EVERY = 12
"""Polls per update of the live view: the rate of the real-time demo."""


def run(
    folder: RunFolder,
    duration_s: float,
    seed: int,
    report_progress: Callable[[str], None],
    show: ShowSample,
) -> None:
    """Run the whole demo; the same seed and duration give the same bytes.

    report_progress, show: as in `orchestrator.run`. Raises DemoInterruptedError after Ctrl-C and ConfigError
    for an unusable configuration.
    """
    loaded = folder.hand()
    names = [finger.name for finger in loaded.fingers]
    radius_mm = 1e3 * loaded.control.tip_radius_m
    folder.truth.mkdir()
    folder.sensors.mkdir(parents=True, exist_ok=True)
    report_progress("making and calibrating the sensors")
    library = load_library()
    sensors = fingertip_sensors(folder.sensors, names, radius_mm, seed, library, report_progress)
    bind_calibrations(folder)
    config, hand = load_hand(folder.hand_toml)
    engine = make_engine(config, "mujoco", has_B=False)
    with ExitStack() as stack:
        stopped = stack.enter_context(stop_event())
        log = stack.enter_context(LogWriter(folder.log, LogHeader(log_header(config, ORIGIN))))
        motion = stack.enter_context(
            MotionFile(folder.motion, [joint.name for joint in config.joints], len(config.fingers))
        )
        truths = [stack.enter_context(FrameTruthFile(folder.truth / f"{name}.csv")) for name in names]
        pictures = [PictureKeeper(folder.pictures(name)) for name in names]

        def keep_frame(finger: int, truth: FrameTruth, image: Image) -> None:
            truths[finger].write(truth)
            pictures[finger].keep(truth.sequence, image)

        contact_source = RenderedContactSource(sensors, library, seed, keep_frame)

        def log_frame(stamp_us: int, frame: CanFrame) -> None:
            log.write(LogRecord(stamp_us, frame))

        def record_motion(now_us: int) -> None:
            if now_us % PERIOD_US == 0:
                motion.write(now_us, engine)

        recorder = HostRecorder(config)

        def record_tick(status: HostStatus) -> None:
            for note in recorder.notes(status):
                log.note(note)

        loop = LockstepLoop(
            *(config, hand, engine, contact_source),
            on_frame=log_frame,
            on_step=record_motion,
            on_tick=record_tick,
        )

        def advance(seconds: float) -> Iterator[float]:
            """Run the loop for `seconds` and yield the elapsed simulated time after each poll."""
            for poll in range(1, round(seconds / POLL_PERIOD_S) + 1):
                if stopped.is_set():
                    raise DemoInterruptedError
                loop.run(POLL_PERIOD_S)
                yield poll * POLL_PERIOD_S

        def send_command(rotate: Rotate) -> HostStatus | None:
            loop.host.command(rotate)
            return loop.status

        for _ in advance(START_TIMEOUT_S):
            if loop.status is not None and loop.status.mode not in STARTING:
                break
        programme = Programme(send_command, folder.commands, duration_s)
        for polls, elapsed_s in enumerate(advance(duration_s)):
            programme.update(loop.status)
            if polls % SHOW_EVERY == 0:
                show(MonitorSample(loop.status, (None,) * len(names), None), elapsed_s)
        loop.host.request_stop()
        for _ in advance(STOP_TIMEOUT_S):
            if loop.is_over:
                break
