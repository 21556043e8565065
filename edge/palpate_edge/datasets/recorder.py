"""Frames kept on disk while somebody asks for them: a folder that `recording.py` plays again.

Each frame is one PNG, whole or not there, and a line in frames.csv. The folder is a ring: beyond its bytes or
its seconds the oldest frames go. Encoding and writing happen in a thread of their own; what it cannot keep up
with is counted and left out, and never holds up the estimate.
"""

from __future__ import annotations

import queue
import threading
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import cv2

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import CaptureError
from palpate_edge.common.frame import Frame

QUEUED_FRAMES = 8
LAST_FRAMES_S = 5.0  # for what is queued when it ends
LOOK_UP_S = 0.1  # how often a writer without frames looks whether it is to end
PNG_LEVEL = 1  # the fastest: a small board has better to do
INDEX = "frames.csv"
INDEX_HEADER = "frame,exposed_at_us,sequence\n"
RENEW_INDEX_EVERY = 30  # frames; between them it may name frames that have gone


@dataclass(frozen=True, slots=True)
class RingLimits:
    """Limits of a recording: bytes of images, and seconds from its first to its last frame."""

    bytes: int
    seconds: float


@dataclass(frozen=True, slots=True)
class _Kept:
    path: Path
    size: int
    exposed_at_us: int
    sequence: int


class FrameRing:
    """The ring's files; one thread uses it."""

    def __init__(self, folder: Path, limits: RingLimits) -> None:
        """Make the folder and remove half-written files of an interrupted recording.

        Raises CaptureError when the disk refuses, or for a folder with frames of an earlier recording.
        """
        self.folder = folder
        self._limits = limits
        self._kept: deque[_Kept] = deque()
        self._size = 0
        self._since_index = 0
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for half_written in folder.glob(".*.tmp"):
                half_written.unlink()
            if any(folder.glob("*.png")):
                raise CaptureError(f"{folder} has frames already: choose another folder or remove it")
        except OSError as error:
            raise CaptureError(f"no recording in {folder}: {error.strerror}") from error

    def add(self, frame: Frame) -> None:
        """Keep a frame and let the oldest go. Raises CaptureError when the disk refuses."""
        _, data = cv2.imencode(".png", frame.image, [cv2.IMWRITE_PNG_COMPRESSION, PNG_LEVEL])
        path = self.folder / f"{frame.sequence:010}.png"
        # Flushing the folder as well would double the cost of a frame; a power cut may lose the last names.
        write_atomically(path, data.tobytes(), CaptureError, sync_folder=False)
        self._kept.append(_Kept(path, data.size, frame.exposed_at_us, frame.sequence))
        self._size += data.size
        self._let_go()
        self._since_index += 1
        if self._since_index >= RENEW_INDEX_EVERY:
            self.write_index()

    def write_index(self) -> None:
        """Write frames.csv for the frames that are kept."""
        self._since_index = 0
        lines = [f"{one.path.name},{one.exposed_at_us},{one.sequence}\n" for one in self._kept]
        text = INDEX_HEADER + "".join(lines)
        write_atomically(self.folder / INDEX, text.encode(), CaptureError)

    def _let_go(self) -> None:
        newest_us = self._kept[-1].exposed_at_us
        oldest_us = newest_us - round(1e6 * self._limits.seconds)
        while len(self._kept) > 1 and (
            self._size > self._limits.bytes or self._kept[0].exposed_at_us < oldest_us
        ):
            oldest = self._kept.popleft()
            oldest.path.unlink(missing_ok=True)
            self._size -= oldest.size


class Recorder:
    """Starts and stops recordings; `offer` takes each frame and never waits.

    written, left_out: frames of all recordings. failure: why the last one ended by itself, or empty.
    """

    def __init__(self, folder: Path, limits: RingLimits) -> None:
        self.written = self.left_out = 0
        self.failure = ""
        self._folder = folder
        self._limits = limits
        self._queue: queue.Queue[Frame] = queue.Queue(QUEUED_FRAMES)
        self._asked_to_stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def is_recording(self) -> bool:
        """Return whether a recording runs or its last frames are being written."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, name: str) -> Path:
        """Begin the recording `name`, when none runs; returns its folder. Raises CaptureError."""
        self.failure = ""
        ring = FrameRing(self._folder / name, self._limits)
        self._queue = queue.Queue(QUEUED_FRAMES)
        self._asked_to_stop.clear()
        self._thread = threading.Thread(target=self._write, args=(ring,), name="recorder", daemon=True)
        self._thread.start()
        return ring.folder

    def offer(self, frame: Frame) -> None:
        """Queue a frame if a recording runs; called by the capture thread."""
        if not self.is_recording or self._asked_to_stop.is_set():
            return
        try:
            self._queue.put_nowait(frame)
        except queue.Full:
            self.left_out += 1

    def stop(self) -> None:
        """End the recording; queued frames are still written, without waiting for them here."""
        self._asked_to_stop.set()

    def close(self) -> None:
        """Stop, and wait until everything is on the disk."""
        self.stop()
        if self._thread is not None:
            self._thread.join(timeout=LAST_FRAMES_S)

    def _write(self, ring: FrameRing) -> None:
        try:
            while True:
                try:
                    frame = self._queue.get(timeout=LOOK_UP_S)
                except queue.Empty:
                    if self._asked_to_stop.is_set():
                        break
                    continue
                ring.add(frame)
                self.written += 1
            ring.write_index()
        except CaptureError as error:  # a full disk ends the recording, never the fingertip
            self.failure = str(error)


def recorded_fps(folder: Path) -> float | None:
    """Return the frame rate of a recording; None when the folder is not one."""
    try:
        lines = (folder / INDEX).read_text().splitlines()[1:]
        rows = [line.split(",") for line in lines]
        stamps = [(int(exposed_at_us), int(sequence)) for _, exposed_at_us, sequence in rows]
    except (OSError, ValueError):
        return None
    if len(stamps) < 2 or stamps[-1][0] <= stamps[0][0]:
        return None
    return 1e6 * (stamps[-1][1] - stamps[0][1]) / (stamps[-1][0] - stamps[0][0])
