"""What the pixel thread reads from, and a source that is opened again after its camera was lost."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

from palpate_edge.common.errors import CameraLostError, CaptureError
from palpate_edge.common.frame import Frame


class Source(Protocol):
    """A capture source that waits for its next frame.

    dropped: frames that were exposed and not read; exposure_us: the camera's setting, 0 where it tells none.
    """

    @property
    def dropped(self) -> int: ...

    @property
    def exposure_us(self) -> int: ...

    def read(self) -> Frame | None:
        """The next frame, None when there will be no more. Raises CaptureError."""
        ...

    def close(self) -> None: ...


class ReopeningSource:
    """A camera that may be lost: `read` fails once and opens it again when it is called the next time.

    Sequence numbers and dropped frames run on over the gap.
    """

    def __init__(self, open_one: Callable[[], Source]) -> None:
        """Raises CaptureError for what will not come by waiting; a camera that is not there may come."""
        self._open_one = open_one
        self._source: Source | None = None
        self._dropped_before = 0
        self._next_sequence = self._first_sequence = 0
        with suppress(CameraLostError):
            self._source = open_one()

    @property
    def dropped(self) -> int:
        source = self._source
        return self._dropped_before + (0 if source is None else source.dropped)

    @property
    def exposure_us(self) -> int:
        source = self._source
        return 0 if source is None else source.exposure_us

    def read(self) -> Frame | None:
        if self._source is None:
            self._source = self._open_one()
        try:
            frame = self._source.read()
        except CaptureError:
            self.close()
            raise
        if frame is None:
            return None
        sequence = self._first_sequence + frame.sequence
        self._next_sequence = sequence + 1
        return replace(frame, sequence=sequence)

    def close(self) -> None:
        """Also between two readings, which then opens it again."""
        source, self._source = self._source, None  # at once: the bus loop asks for `dropped` meanwhile
        if source is not None:
            self._dropped_before += source.dropped
            self._first_sequence = self._next_sequence
            source.close()
