"""The camera that a run and its page share: no frame twice, and no wait without an end."""

from __future__ import annotations

import threading
from contextlib import closing

import numpy as np
import pytest

from palpate_edge.common.errors import CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.press_rig.watched_camera import WatchedCamera

IMAGE = np.zeros((4, 4), np.uint8)


class Steps:
    """A source whose reads wait until the test lets them go on."""

    dropped = damaged = exposure_us = 0

    def __init__(self, *results):
        self._results = list(results)
        self.next = threading.Semaphore(0)

    def read(self):
        self.next.acquire()
        result = self._results.pop(0)
        if isinstance(result, CaptureError):
            raise result
        return result

    def close(self):
        pass


def frame(sequence):
    return Frame(IMAGE, 1000 * sequence, sequence, "drawn")


def test_the_run_gets_the_next_frame_an_error_and_the_end_and_the_page_every_frame():
    source, shown = Steps(frame(1), CaptureError("unplugged"), frame(2), None), []
    with closing(WatchedCamera(source, shown.append)) as camera:
        source.next.release()
        assert camera.read().sequence == 1
        source.next.release()
        with pytest.raises(CaptureError, match="unplugged"):
            camera.read()
        source.next.release()
        assert camera.read().sequence == 2
        source.next.release()
        assert camera.read() is None
    assert [one.sequence for one in shown] == [1, 2]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_page_that_fails_ends_the_pictures_and_the_run_does_not_wait():
    def fail(_frame):
        raise ValueError("a fault of the page")

    source = Steps(frame(1), frame(2))
    with closing(WatchedCamera(source, fail)) as camera:
        source.next.release()
        assert camera.read().sequence == 1
        assert camera.read() is None
