"""The capture protocol, and a source that reopens its camera after a loss."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Protocol

import msgspec

from palpate_edge.common.errors import CameraLostError, CaptureError
from palpate_edge.common.frame import Frame


class Source(Protocol):
    """A capture source: the capture thread reads one frame after the other."""

    @property
    def dropped(self) -> int:
        """Frames that were exposed and not read, damaged ones included, since the source was opened."""
        ...

    @property
    def damaged(self) -> int:
        """Frames that were received incomplete or undecodable, since the source was opened."""
        ...

    @property
    def exposure_us(self) -> int:
        """The camera's exposure time; 0 when it is not known."""
        ...

    def read(self) -> Frame | None:
        """Wait for the next frame and return it; None when there will be no more.

        Raises CameraLostError or CameraStalledError when another attempt may succeed, else CaptureError.
        """
        ...

    def close(self) -> None:
        """Release the camera."""
        ...


class ReopeningSource:
    """A camera that may be lost: after a failed `read` the next call opens it again.

    Sequence numbers and counters continue over the gap.
    """

    def __init__(self, open_source: Callable[[], Source]) -> None:
        """Raises CaptureError when the camera cannot be used; a missing camera is opened by a later
        `read`."""
        self._open_source = open_source
        self._source: Source | None = None
        self._dropped_before = self._damaged_before = 0
        self._next_sequence = self._first_sequence = 0
        with suppress(CameraLostError):
            self._source = open_source()

    @property
    def dropped(self) -> int:
        source = self._source
        return self._dropped_before + (0 if source is None else source.dropped)

    @property
    def damaged(self) -> int:
        source = self._source
        return self._damaged_before + (0 if source is None else source.damaged)

    @property
    def exposure_us(self) -> int:
        source = self._source
        return 0 if source is None else source.exposure_us

    def read(self) -> Frame | None:
        if self._source is None:
            self._source = self._open_source()
        try:
            frame = self._source.read()
        except CaptureError:
            self.close()
            raise
        if frame is None:
            return None
        sequence = self._first_sequence + frame.sequence
        self._next_sequence = sequence + 1
        return msgspec.structs.replace(frame, sequence=sequence)

    def close(self) -> None:
        """Close the camera; a later `read` opens it again."""
        source, self._source = self._source, None  # at once: the bus loop reads the counters meanwhile
        if source is not None:
            self._dropped_before += source.dropped
            self._damaged_before += source.damaged
            self._first_sequence = self._next_sequence
            source.close()
