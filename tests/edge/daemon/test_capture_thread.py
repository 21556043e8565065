"""The capture thread hands every contact and every failure to the bus loop."""

from __future__ import annotations

import select
import threading
from contextlib import closing

import numpy as np
import pytest

from palpate_edge.common.contact import refused_contact
from palpate_edge.common.errors import CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.daemon.capture_thread import CaptureThread

PATIENCE_S = 30.0


class Script:
    """A source that plays a list: a frame number, or an exception to raise; then it ends."""

    dropped = damaged = 0
    exposure_us = 0

    def __init__(self, *steps):
        self._steps = list(steps)
        self.closed = False

    def read(self):
        if not self._steps:
            return None
        step = self._steps.pop(0)
        if isinstance(step, Exception):
            raise step
        return Frame(np.zeros((4, 4), dtype=np.uint8), 1000 * step, step, str(step))

    def close(self):
        self.closed = True


class Numbers:
    """An estimator that gives each frame's number as a contact."""

    def estimate(self, frame):
        return refused_contact(frame.sequence, frame.exposed_at_us, "test", 0, 0)


def finished_thread(*steps):
    """A thread that has played all its steps before anything was taken."""
    pixels = CaptureThread(Script(*steps), Numbers())
    pixels.start()
    pixels.join(PATIENCE_S)
    assert not pixels.is_alive()
    return pixels


def readable(pixels):
    return bool(select.select([pixels.fileno()], [], [], 0)[0])


def test_contacts_come_in_order_and_then_it_is_finished():
    with closing(finished_thread(1, 2, 3)) as pixels:
        assert not pixels.finished  # there is something to take
        assert readable(pixels)
        assert [contact.sequence for contact in pixels.take()] == [1, 2, 3]
        assert pixels.finished
        assert not readable(pixels)
        assert pixels.take() == []


@pytest.mark.parametrize("frames", [(), (1,), (1, 2, 3)], ids=["at once", "after one", "after three"])
def test_a_refusal_is_raised_in_the_taking_thread_behind_the_last_contact(frames):
    with closing(finished_thread(*frames, CaptureError("camera gone: plug it in"))) as pixels:
        if frames:
            assert [contact.sequence for contact in pixels.take()] == list(frames)
        for _ in range(2):
            with pytest.raises(CaptureError, match="camera gone: plug it in"):
                pixels.take()
        assert not pixels.finished


def test_a_fault_of_the_program_is_raised_with_its_cause():
    with closing(finished_thread(ZeroDivisionError("oops"))) as pixels:
        with pytest.raises(RuntimeError, match="capture thread died") as error:
            pixels.take()
        assert isinstance(error.value.__cause__, ZeroDivisionError)


def test_closing_stops_an_endless_source_and_releases_it():
    class Endless(Script):
        def __init__(self):
            super().__init__()
            self.reads = 0
            self.started = threading.Event()

        def read(self):
            self.reads += 1
            self.started.set()
            threading.Event().wait(0.001)
            return Frame(np.zeros((4, 4), dtype=np.uint8), 0, self.reads, "")

    source = Endless()
    pixels = CaptureThread(source, Numbers())
    pixels.start()
    assert source.started.wait(PATIENCE_S)
    pixels.close()
    assert not pixels.is_alive()
    assert source.closed


def test_closing_a_thread_that_never_started_releases_its_source():
    source = Script()
    CaptureThread(source, Numbers()).close()
    assert source.closed
