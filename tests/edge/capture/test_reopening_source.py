"""A camera that goes and comes back, and the thread that reads it."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

from palpate_edge.capture.source import ReopeningSource
from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.errors import CameraLostError, CameraStalledError, CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.daemon.capture_thread import CaptureThread

LOST, STALLED = CameraLostError("unplugged"), CameraStalledError("silent")


class Camera:
    """Counts from 0 as a camera does that was just opened; plays numbers and errors."""

    def __init__(self, *steps, exposure_us=0):
        self._steps = list(steps)
        self.exposure_us = exposure_us
        self.dropped = self.damaged = 0
        self.closed = 0

    def read(self):
        step = self._steps.pop(0)
        if isinstance(step, Exception):
            raise step
        self.dropped = max(self.dropped, step // 10)
        self.damaged = max(self.damaged, step // 20)
        return Frame(np.zeros((2, 2), dtype=np.uint8), 1000 * step, step, "camera")

    def close(self):
        self.closed += 1


class Port:
    """Where cameras are plugged in one after the other; an error stands for what opening gives."""

    def __init__(self, *openings):
        self.openings = list(openings)

    def open(self):
        one = self.openings.pop(0)
        if isinstance(one, Exception):
            raise one
        return one


def read_all(source, count):
    got = []
    for _ in range(count):
        try:
            got.append(source.read().sequence)
        except CaptureError as error:
            got.append(str(error))
    return got


def test_numbers_and_drops_run_on_over_the_gap():
    first, second = Camera(0, 1, 12, LOST), Camera(0, 1, 25)
    source = ReopeningSource(Port(first, LOST, second).open)
    assert read_all(source, 8) == [0, 1, 12, "unplugged", "unplugged", 13, 14, 38]
    assert first.closed == 1
    assert source.dropped == 1 + 2
    assert source.damaged == 0 + 1


def test_a_camera_that_is_not_there_at_the_start_may_come():
    source = ReopeningSource(Port(LOST, LOST, Camera(0)).open)
    assert read_all(source, 2) == ["unplugged", 0]


def test_the_exposure_is_that_of_the_camera_of_now():
    source = ReopeningSource(Port(Camera(0, LOST, exposure_us=4_000), Camera(0, exposure_us=8_000)).open)
    assert source.exposure_us == 4_000
    read_all(source, 2)
    assert source.exposure_us == 0
    read_all(source, 1)
    assert source.exposure_us == 8_000


def test_one_that_cannot_be_used_is_refused_at_the_start():
    with pytest.raises(CaptureError, match="two have it"):
        ReopeningSource(Port(CaptureError("two have it")).open)


class Numbers:
    def estimate(self, frame):
        return refused_contact(frame.sequence, frame.exposed_at_us, "test", 0, 0)


def test_the_thread_tells_of_a_lost_camera_and_reads_on():
    source = ReopeningSource(Port(Camera(0, STALLED), LOST, Camera(0, CaptureError("the end"))).open)
    with closing(CaptureThread(source, Numbers())) as pixels:
        pixels.start()
        pixels.join(30)
        outcomes = pixels.take()
        with pytest.raises(CaptureError, match="the end"):
            pixels.take()
    told = [one.sequence if isinstance(one, Contact) else str(one) for one in outcomes]
    assert told == [0, "silent", "unplugged", 1]


def test_a_thread_that_waits_for_a_camera_ends_when_asked():
    source = ReopeningSource(Port(LOST, *[LOST] * 50).open)
    pixels = CaptureThread(source, Numbers())
    pixels.start()
    pixels.close()
    assert not pixels.is_alive()
