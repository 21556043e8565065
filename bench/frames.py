"""What the estimator is timed on: the demo's calibration set and one of its videos as grey JPEG frames."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibrate import calibrate
from palpate_edge.calibration import Calibration, load_calibration, save_calibration
from palpate_edge.capture.frame import Frame
from palpate_edge.capture.recorded import all_frames, open_recording
from palpate_edge.dataset import read_dataset
from palpate_edge.training.dome_model import load_dome_model

RECORDING = Path(__file__).resolve().parents[1] / "demo" / "recording"
JPEG_QUALITY = 90


@dataclass(frozen=True, slots=True)
class Material:
    """calibration; grey frames of a moving contact; the same frames as JPEG files' bytes."""

    calibration: Calibration
    frames: tuple[Frame, ...]
    jpegs: tuple[NDArray[np.uint8], ...]


def load() -> Material:
    """Calibrate on the demo's presses and decode the first finger's video."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.cal"
        save_calibration(calibrate(read_dataset(RECORDING / "press"), dome=load_dome_model()), path)
        calibration = load_calibration(path)
    recording = open_recording(RECORDING / "finger-1")
    frames = []
    for frame in all_frames(recording):
        grey = cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY) if frame.image.ndim == 3 else frame.image
        frames.append(Frame(np.asarray(grey, np.uint8), frame.exposed_at_us, frame.sequence, frame.name))
    recording.close()
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    jpegs = tuple(np.asarray(cv2.imencode(".jpg", frame.image, quality)[1], np.uint8) for frame in frames)
    return Material(calibration, tuple(frames), jpegs)
