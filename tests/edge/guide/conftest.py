"""A person at the guide: twin frames as the camera gives them, time by the frame, answers by the step."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from palpate_edge.calibration.calibrate import Progress
from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.arrays import Image
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.weights_table import NEWTONS_PER_GRAM
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.guide.calibration_guide import FitCalibration
from palpate_edge.guide.guide_files import GuideFiles
from palpate_edge.jig.jig_plan import Hole
from palpate_twin.camera.random_presses import printed_axes, rod_press, weighed_press
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import sensor_toml
from palpate_twin.dome.library import load_library

SEED = 301
FPS = 15.0
UNTOUCHED = 23  # distinct noise, also where only every second or fourth picture is taken: 23 is prime


class TableCamera:
    """A camera whose pictures go to a ring in shared memory; `shown` is what is before it."""

    def __init__(self, path: Path, images: list[Image]) -> None:
        self.shown = images
        height, width = images[0].shape[:2]
        self._writer = RingWriter(path, RingFormat(width, height, 3))
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        number = 0
        while not self._stopped.wait(1 / FPS):
            image = self.shown[number % len(self.shown)].copy()
            image[0, 0] = number % 256  # a camera whose pictures are all alike is frozen
            number += 1
            self._writer.write(image, number, time.monotonic_ns() // 1000)

    def close(self) -> None:
        self._stopped.set()
        self._thread.join()
        self._writer.close()


class Bench:
    """A sensor of the twin on a kitchen table: pictures of the untouched dome, presses with their grams."""

    def __init__(self) -> None:
        self.view = CameraView(random_sensor(SEED), load_library())
        rng = np.random.default_rng(1)
        self.untouched: list[Image] = [self.view.frame(None, rng)[0].copy() for _ in range(UNTOUCHED)]
        self.presses: list[tuple[Image, float]] = []
        for _ in range(12):
            press = weighed_press(self.view.dome, rng)
            image, force_N = self.view.frame(press, rng)
            self.presses.append((image.copy(), float(round(-force_N @ press.outward / NEWTONS_PER_GRAM))))

    def at_rest(self, number: int) -> Image:
        """A picture of the untouched dome; its noise comes again after `UNTOUCHED` pictures."""
        return self.untouched[number % UNTOUCHED]

    def through(self, hole: Hole) -> tuple[Image, float]:
        """The picture of a rod with a weight in a hole of the jig, and the grams of both."""
        radius_mm, rng = self.view.twin.sensor.dome.outer_radius_mm, np.random.default_rng([2, hole.number])
        (axis,) = printed_axes([hole], radius_mm, rng)
        press, share = rod_press(self.view.dome, axis, rng)
        image, force_N = self.view.frame(press, rng)
        return image.copy(), float(round(-force_N @ press.outward / NEWTONS_PER_GRAM / share))

    def files(self, folder: Path) -> GuideFiles:
        """A folder with the sensor's description alone."""
        folder.mkdir()
        (folder / "sensor.toml").write_text(sensor_toml(self.view.twin.sensor))
        return FittedOnce(folder, folder.with_suffix(".cal"))

    @contextmanager
    def camera(self, folder: Path) -> Iterator[tuple[TableCamera, Path]]:
        """A camera before the untouched dome, and a fingertip's configuration that uses it."""
        self.files(folder / "presses")
        config = folder / "finger.toml"
        config.write_text(
            f'name = "table"\nhealth = "{folder / "table.health"}"\n'
            f'[capture]\nsource = "shared_memory"\npath = "{folder / "ring"}"\n'
            '[estimator]\nsensor = "presses/sensor.toml"\n'
            'calibration = "table.cal"\ncalibration_required = false\n'
            f'[node]\nid = 16\n[bus]\ninterface = "palpate"\nchannel = "{folder / "no-hub.sock"}"\n'
        )
        with closing(TableCamera(folder / "ring", self.untouched)) as camera:
            yield camera, config


class FittedOnce(GuideFiles):
    """Fits to the reference frames once for all tests: the dome's pictures are always the same."""

    rest: ClassVar[Calibration | None] = None

    def fit(self, work: FitCalibration, progress: Progress) -> Calibration:
        if work.with_presses:
            return super().fit(work, progress)
        FittedOnce.rest = FittedOnce.rest or super().fit(work, progress)
        return FittedOnce.rest


class PlayedSource:
    """A capture source that shows what the person does: `image` is the picture in front of the camera."""

    dropped = damaged = exposure_us = 0

    def __init__(self, pictures: Callable[[int], Image], fps: float = 10.0) -> None:
        self._pictures, self._fps, self._sequence = pictures, fps, 0

    def read(self) -> Frame | None:
        self._sequence += 1
        return Frame(
            self._pictures(self._sequence), round(1e6 * self._sequence / self._fps), self._sequence, ""
        )

    def close(self) -> None: ...


@pytest.fixture(scope="session")
def bench() -> Bench:
    return Bench()
