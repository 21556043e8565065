"""Cameras of the simulated fingertips: a process that renders frames into shared-memory rings.

It is a separate process because rendering a frame takes longer than the drives may wait for the hand.
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
from palpate_twin.camera.frame_truth import FrameTruth, FrameTruthFile
from palpate_twin.camera.kept_pictures import PictureKeeper
from palpate_twin.camera.look import load_twin
from palpate_twin.camera.renderer import CameraView
from palpate_twin.closed_loop.tactile_rendering import DomeContact, press_for
from palpate_twin.dome.library import load_library

START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 5.0
ENDED = "the camera process has ended: its error message is above"


@dataclass(frozen=True, slots=True)
class CameraFiles:
    """Files of one fingertip: its true sensor (twin.json), the frame ring, the truth and the folder of
    pictures to write."""

    sensor: Path
    ring: Path
    truth: Path
    pictures: Path


@dataclass(frozen=True, slots=True)
class Exposure:
    """A frame to render. exposed_at_us: time of the exposure on CLOCK_MONOTONIC."""

    finger: int
    sequence: int
    exposed_at_us: int
    contact: DomeContact | None


class LiveCameras:
    """Client of the camera process. fps: frame rate of each camera."""

    def __init__(self, files: Sequence[CameraFiles], seed: int) -> None:
        """Start the process and wait until it is ready. Raises ConfigError if a camera cannot be created."""
        context = get_context("spawn")
        self._pipe, child_end = context.Pipe()
        self._process = context.Process(target=_serve, args=(list(files), seed, child_end), daemon=True)
        self._process.start()
        child_end.close()
        try:
            if not self._pipe.poll(START_TIMEOUT_S):
                raise ConfigError(
                    f"the camera process was not ready within {START_TIMEOUT_S:g} s: "
                    "stop other programs on this machine and try again"
                )
            reply = self._pipe.recv()
        except EOFError:
            raise ConfigError(ENDED) from None
        finally:
            if not self._process.is_alive():
                self._process.join()
        if isinstance(reply, str):
            raise ConfigError(reply)
        self.fps: list[float] = reply
        self._busy: set[int] = set()

    def is_busy(self, finger: int) -> bool:
        """Return whether a frame is being rendered. Raises ConfigError if the process has ended."""
        try:
            while self._busy and self._pipe.poll():
                self._busy.discard(self._pipe.recv())
        except (OSError, EOFError):
            raise ConfigError(ENDED) from None
        return finger in self._busy

    def expose(self, exposure: Exposure) -> None:
        """Start rendering a frame. Raises ConfigError if the process has ended."""
        try:
            self._pipe.send(exposure)
        except OSError:
            raise ConfigError(ENDED) from None
        self._busy.add(exposure.finger)

    def close(self) -> None:
        """End the process and remove the rings."""
        with suppress(OSError):
            self._pipe.send(None)
        self._process.join(STOP_TIMEOUT_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._pipe.close()


def _serve(files: Sequence[CameraFiles], seed: int, pipe: Connection) -> None:
    """Run the camera process.

    It first sends the frame rates, or an error message as text. Then it renders each received exposure and
    sends back its finger, until it receives None or the pipe is closed.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the hand handles Ctrl-C and closes the pipe
    os.setsid()  # Linux divides processor time between sessions (autogroup): rendering gets its own share
    cv2.setNumThreads(1)
    with ExitStack() as stack:
        try:
            library = load_library()
            cameras = [_Camera(paths, CameraView(load_twin(paths.sensor), library), stack) for paths in files]
        except Exception as error:  # noqa: BLE001 - reported to the hand's process, which raises it
            pipe.send(str(error))
            return
        rng = np.random.default_rng([seed, 9])
        pipe.send([camera.view.twin.sensor.camera.fps for camera in cameras])
        with suppress(EOFError, OSError):  # the hand's process has ended
            while (exposure := pipe.recv()) is not None:
                cameras[exposure.finger].render(exposure, rng)
                pipe.send(exposure.finger)


class _Camera:
    """One fingertip's renderer with its frame ring, truth file and kept pictures."""

    def __init__(self, paths: CameraFiles, view: CameraView, stack: ExitStack) -> None:
        camera = view.twin.sensor.camera
        form = RingFormat(camera.width, camera.height, 3, fingerprint=view.twin.sensor.fingerprint())
        self.view = view
        self._radius_mm = view.twin.sensor.dome.outer_radius_mm
        self._ring = stack.enter_context(closing(RingWriter(paths.ring, form)))
        self._truth = stack.enter_context(FrameTruthFile(paths.truth))
        self._pictures = PictureKeeper(paths.pictures)

    def render(self, exposure: Exposure, rng: np.random.Generator) -> None:
        """Write a frame into the ring and its true contact into the truth file."""
        press = None if exposure.contact is None else press_for(self.view, exposure.contact)
        image, force_N = self.view.frame(press, rng)
        self._ring.write(image, exposure.sequence, exposure.exposed_at_us)
        point_mm = None if press is None else self._radius_mm * press.outward
        self._truth.write(FrameTruth(exposure.sequence, exposure.exposed_at_us, point_mm, force_N))
        self._pictures.keep(exposure.sequence, image)
