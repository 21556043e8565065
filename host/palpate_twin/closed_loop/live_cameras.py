"""The fingertips' cameras of a simulated hand: a process that renders what it is told into rings of frames.

A process of its own, because a picture takes longer than the drives may wait for the hand.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import cv2
import numpy as np

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.errors import ConfigError
from palpate_twin.camera.look import load_twin
from palpate_twin.camera.renderer import CameraView
from palpate_twin.closed_loop.fingertip_feel import DomeTouch, Picture, press_of
from palpate_twin.closed_loop.picture_file import PictureFile
from palpate_twin.dome.library import load_library

READY_S = 60.0
STOP_S = 5.0
ENDED = "the cameras' process has ended: see what it said above"


@dataclass(frozen=True, slots=True)
class CameraFiles:
    """One fingertip's files: the sensor as it is (twin.json), the ring to make, the truth to write."""

    sensor: Path
    ring: Path
    truth: Path


@dataclass(frozen=True, slots=True)
class Exposure:
    """What one camera shall see. exposed_at_us: of CLOCK_MONOTONIC."""

    finger: int
    sequence: int
    exposed_at_us: int
    touch: DomeTouch | None


class LiveCameras:
    """The process; `fps` is known once it is ready."""

    def __init__(self, files: Sequence[CameraFiles], seed: int) -> None:
        """Raises ConfigError when the cameras cannot be made."""
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(list(files), seed, theirs), daemon=True)
        self._process.start()
        theirs.close()
        try:
            if not self._pipe.poll(READY_S):
                raise ConfigError(f"the cameras were not ready within {READY_S:g} s: is the machine busy?")
            answer = self._pipe.recv()
        except EOFError:
            raise ConfigError("the cameras' process ended at its start: see what it said above") from None
        finally:
            if not self._process.is_alive():
                self._process.join()
        if isinstance(answer, str):
            raise ConfigError(answer)
        self.fps: list[float] = answer
        self._busy: set[int] = set()

    def is_busy(self, finger: int) -> bool:
        """Whether its last picture is not drawn yet. Raises ConfigError when the process has died."""
        try:
            while self._busy and self._pipe.poll():
                self._busy.discard(self._pipe.recv())
        except (OSError, EOFError):
            raise ConfigError(ENDED) from None
        return finger in self._busy

    def expose(self, exposure: Exposure) -> None:
        """Begin a picture. Raises ConfigError when the process has died."""
        try:
            self._pipe.send(exposure)
        except OSError:
            raise ConfigError(ENDED) from None
        self._busy.add(exposure.finger)

    def close(self) -> None:
        """End the process and remove the rings."""
        with suppress(OSError):
            self._pipe.send(None)
        self._process.join(STOP_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()


def _serve(files: Sequence[CameraFiles], seed: int, pipe: Connection) -> None:
    """Answers with the frame rates, or with what is wrong as text; then renders until None or the end of the
    pipe, and tells of each picture whose it was."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the hand, which then closes the pipe
    os.setsid()  # Linux shares the processor out by session (autogroup): pictures get a share of their own
    cv2.setNumThreads(1)
    with ExitStack() as stack:
        try:
            library = load_library()
            cameras = [_Camera(paths, CameraView(load_twin(paths.sensor), library), stack) for paths in files]
        except Exception as error:  # noqa: BLE001 - not swallowed: the hand's process raises it
            pipe.send(str(error))
            return
        rng = np.random.default_rng([seed, 9])
        pipe.send([camera.view.twin.sensor.camera.fps for camera in cameras])
        with suppress(EOFError, OSError):  # the hand's process is gone
            while (exposure := pipe.recv()) is not None:
                cameras[exposure.finger].render(exposure, rng)
                pipe.send(exposure.finger)


class _Camera:
    def __init__(self, paths: CameraFiles, view: CameraView, stack: ExitStack) -> None:
        camera = view.twin.sensor.camera
        form = RingFormat(camera.width, camera.height, 3, fingerprint=view.twin.sensor.fingerprint())
        self.view = view
        self._radius_mm = view.twin.sensor.dome.outer_radius_mm
        self._ring = stack.enter_context(closing(RingWriter(paths.ring, form)))
        self._truth = stack.enter_context(PictureFile(paths.truth))

    def render(self, exposure: Exposure, rng: np.random.Generator) -> None:
        """A frame into the ring, and what pressed into the truth."""
        press = None if exposure.touch is None else press_of(self.view, exposure.touch)
        image, force_N = self.view.frame(press, rng)
        self._ring.write(image, exposure.sequence, exposure.exposed_at_us)
        point_mm = None if press is None else self._radius_mm * press.outward
        self._truth.note(Picture(exposure.sequence, exposure.exposed_at_us, point_mm, force_N))
