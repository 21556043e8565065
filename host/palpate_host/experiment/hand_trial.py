"""One trial on a real hand: a host for it, the operator's commands, the external camera, a recording.

The host runs from a copy of hand.toml in the same folder, with the trial's law. One thread records the host's
statuses, another tracks the object; ``palpate-host bus log`` or the hub record the bus. Needs the extra
record.
"""

from __future__ import annotations

import re
import threading
import time
from pathlib import Path

import numpy as np

from palpate_edge.common.atomic_write import make_folder, write_atomically
from palpate_edge.common.errors import ConfigError, PalpateError
from palpate_host.config.control_config import ControlMode
from palpate_host.experiment.protocol import ExperimentConfig, ExternalCameraConfig, TrialCase
from palpate_host.experiment.result import TrialResult
from palpate_host.groundtruth.frames import camera_frames
from palpate_host.groundtruth.intrinsics import read_intrinsics
from palpate_host.groundtruth.track import Marker, ObjectSighting, ObjectTracker, turns, write_csv
from palpate_host.operator.client import NoHostError
from palpate_host.operator.session import Hand
from palpate_host.recording.mcap import McapRecording
from palpate_host.service.host import load_hand, now_us

_CONTROL_MODE = re.compile(r'(^\[control\]\n(?:(?!\[).*\n)*?mode\s*=\s*)"\w+"', re.MULTILINE)
_INTEGRAL = re.compile(r"^integral_per_s\s*=.*\n", re.MULTILINE)


def with_law(text: str, law: ControlMode, integral_per_s: float) -> str:
    """Return hand.toml's text with this law and integral. Raises ConfigError when it has no control.mode."""
    text = _INTEGRAL.sub("", text)
    changed, count = _CONTROL_MODE.subn(rf'\g<1>"{law.value}"\nintegral_per_s = {integral_per_s!r}', text)
    if count != 1:
        raise ConfigError('hand.toml has no control.mode: write mode = "proposed" into its [control]')
    return changed


def run_hand_trial(
    hand_toml: Path, experiment: ExperimentConfig, case: TrialCase, folder: Path
) -> TrialResult:
    """Grasp, turn, wait and open; write hand.mcap and truth.csv into `folder`.

    Raises HandStoppedError or CommandError when the hand fails, CaptureError or ConfigError for the camera.
    """
    assert experiment.camera is not None  # `load` has checked it
    make_folder(folder, ConfigError)
    config_path = hand_toml.with_name(f"{hand_toml.stem}.{case.law.value}.toml")
    text = with_law(hand_toml.read_text(encoding="utf-8"), case.law, experiment.integral_per_s)
    write_atomically(config_path, text.encode(), ConfigError)
    watch = _TrialWatch(experiment.camera)
    with Hand.open(config_path, folder / "host.sock") as hand, _Recorder(config_path, hand, folder):
        hand.grasp()
        time.sleep(experiment.settle_s)
        watch.start()
        begin_us = now_us()
        hand.rotate(case.turn.rpy_deg, timeout_s=experiment.seconds)
        time.sleep(max(0.0, experiment.seconds - 1e-6 * (now_us() - begin_us)))
        sights = watch.end()
        hand.release()
    write_csv(folder / "truth.csv", sights)
    seen = [(sight.time_us, turn) for sight, turn in turns(sights) if turn is not None]
    if not seen:
        raise ConfigError(f"{folder}/truth.csv: no picture has a pose: see its reasons")
    return TrialResult(
        case=case,
        folder=folder,
        time_s=1e-6 * (np.array([time_us for time_us, _ in seen], dtype=np.float64) - begin_us),
        turn=[turn for _, turn in seen],
        true_turn=(),
        slip_mm=None,
        pictures=len(sights),
        failure="",
    )


class _TrialWatch:
    """The thread that tracks the object with the external camera."""

    def __init__(self, camera: ExternalCameraConfig) -> None:
        base = None if camera.base is None else Marker(camera.base[0], 1e-3 * camera.base[1])
        object_marker = Marker(camera.marker[0], 1e-3 * camera.marker[1])
        self._camera = camera
        self._tracker = ObjectTracker(read_intrinsics(Path(camera.intrinsics)), object_marker, base)
        self._sights: list[ObjectSighting] = []
        self._stopped = threading.Event()
        self._failure: PalpateError | None = None
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> list[ObjectSighting]:
        """Stop, and return the measurements. Raises the camera's error when it failed."""
        self._stopped.set()
        self._thread.join()
        if self._failure is not None:
            raise self._failure
        return self._sights

    def _run(self) -> None:
        camera = self._camera
        size_px = (camera.width_px, camera.height_px)
        try:
            for time_us, picture in camera_frames(
                Path(camera.device), size_px, camera.fps, camera.exposure_us, self._stopped, None
            ):
                self._sights.append(self._tracker.look(time_us, picture))
        except PalpateError as exc:
            self._failure = exc


class _Recorder:
    """The thread that writes every tick's status into hand.mcap."""

    def __init__(self, config_path: Path, hand: Hand, folder: Path) -> None:
        config, model = load_hand(config_path)
        self._hand = hand
        self._mcap = McapRecording(folder / "hand.mcap", model, [finger.name for finger in config.fingers])
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    def __enter__(self) -> _Recorder:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()
        self._mcap.close()

    def _run(self) -> None:
        try:
            for status in self._hand.stream():
                self._mcap.write(status)
                if self._stopped.is_set():
                    return
        except NoHostError:
            return  # the trial itself raises the same error
