"""Recordings as a capture source: every frame once, or in real time on a clock of the test's own."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest

from palpate_edge.common.errors import CaptureError, DatasetError
from palpate_edge.datasets.recording import RealTimeSource, all_frames, open_recording

PERIOD_US = 40_000  # 25 frames a second
START_US = 5_000_000


class TenFrames:
    """A recording whose frame k is a picture of the value k."""

    count = 10
    fps = 25.0
    sensor = None
    closed = False

    def read(self, index):
        if index == 7 and self.broken:
            raise DatasetError("frame 7 cannot be read: record it again")
        return np.full((4, 4), index, dtype=np.uint8), f"{index}.png"

    def close(self):
        self.closed = True

    def __init__(self, broken=False):
        self.broken = broken


class Clock:
    """Moves only when slept on or told to."""

    def __init__(self):
        self.now_us = START_US
        self.slept_us = []

    def sleep(self, seconds):
        self.slept_us.append(round(seconds * 1e6))
        self.now_us += round(seconds * 1e6)


def source_of(recording, clock, **options):
    return RealTimeSource(recording, clock_us=lambda: clock.now_us, sleep_s=clock.sleep, **options)


def test_frames_come_at_the_recordings_rate():
    clock = Clock()
    source = source_of(TenFrames(), clock)
    frames = [source.read() for _ in range(10)]
    assert [frame.sequence for frame in frames] == list(range(10))
    assert [frame.exposed_at_us for frame in frames] == [START_US + k * PERIOD_US for k in range(10)]
    assert [int(frame.image[0, 0]) for frame in frames] == list(range(10))
    assert [frame.name for frame in frames][:2] == ["0.png", "1.png"]
    assert clock.slept_us == [PERIOD_US] * 9
    assert source.dropped == 0
    assert source.read() is None


def test_the_reader_sleeps_only_for_what_is_left_of_a_period():
    clock = Clock()
    source = source_of(TenFrames(), clock)
    source.read()
    clock.now_us += 30_000
    assert source.read().exposed_at_us == START_US + PERIOD_US
    assert clock.slept_us == [10_000]


def test_a_late_reader_misses_frames_and_the_sequence_tells():
    clock = Clock()
    source = source_of(TenFrames(), clock)
    assert source.read().sequence == 0
    clock.now_us += 4 * PERIOD_US + 1
    frame = source.read()
    assert frame.sequence == 4
    assert frame.exposed_at_us == START_US + 4 * PERIOD_US
    assert int(frame.image[0, 0]) == 4
    assert source.dropped == 3
    assert source.read().sequence == 5


def test_nothing_is_dropped_after_the_end():
    clock = Clock()
    source = source_of(TenFrames(), clock)
    source.read()
    clock.now_us += 1000 * PERIOD_US
    assert source.read() is None
    assert source.read() is None
    assert source.dropped == 9


def test_a_loop_goes_on_with_rising_sequence_and_time():
    clock = Clock()
    source = source_of(TenFrames(), clock, loop=True)
    frames = [source.read() for _ in range(25)]
    assert [frame.sequence for frame in frames] == list(range(25))
    assert [int(frame.image[0, 0]) for frame in frames] == [k % 10 for k in range(25)]
    clock.now_us += 12 * PERIOD_US
    frame = source.read()
    assert (frame.sequence, int(frame.image[0, 0]), source.dropped) == (36, 6, 11)


def test_a_frame_that_cannot_be_read_stops_the_source():
    clock = Clock()
    source = source_of(TenFrames(broken=True), clock)
    with pytest.raises(CaptureError, match="the recording stopped: frame 7 cannot be read"):
        for _ in range(10):
            source.read()


def test_closing_closes_the_recording():
    recording = TenFrames()
    source_of(recording, Clock()).close()
    assert recording.closed


def test_every_frame_of_a_dataset_in_name_order(drawn_dataset):
    recording = open_recording(drawn_dataset, grey=False)
    frames = list(all_frames(recording))
    assert [frame.name for frame in frames] == [f"{k:03}.png" for k in range(60)]
    assert [frame.sequence for frame in frames] == list(range(60))
    assert frames[30].exposed_at_us == 1_000_000  # 30 frames a second
    assert np.array_equal(frames[7].image, cv2.imread(str(drawn_dataset / "frames" / "007.png")))
    assert recording.sensor is not None


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    """12 lossless-enough frames: frame k is grey level 20 k."""
    path = tmp_path_factory.mktemp("video") / "steps.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 25, (64, 48))
    assert writer.isOpened()
    for level in range(12):
        writer.write(np.full((48, 64, 3), 20 * level, dtype=np.uint8))
    writer.release()
    return path


def test_a_video_gives_its_frames_forwards_and_backwards(video):
    recording = open_recording(video)
    assert (recording.count, recording.fps) == (12, 25.0)
    for index in (0, 1, 5, 11, 3, 3):
        image, name = recording.read(index)
        assert abs(float(image.mean()) - 20 * index) < 3
        assert name == f"steps.avi#{index}"
    recording.close()


def test_a_video_beside_a_description_is_its_frames(drawn_dataset, video, tmp_path):
    shutil.copytree(drawn_dataset, tmp_path / "d", ignore=shutil.ignore_patterns("frames", "truth.csv"))
    shutil.copy(video, tmp_path / "d" / "frames.avi")
    recording = open_recording(tmp_path / "d")
    assert recording.count == 12
    assert recording.sensor is not None
    recording.close()


def test_one_image_is_a_recording_of_one_frame(drawn_dataset):
    frames = list(all_frames(open_recording(drawn_dataset / "frames" / "000.png")))
    assert [(frame.name, frame.sequence) for frame in frames] == [("000.png", 0)]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("text.mp4", b"this is no video", "is not a video that can be decoded"),
        ("empty.avi", b"", "is not a video that can be decoded"),
        ("notes.txt", b"hello", "is not an image or a video"),
    ],
)
def test_files_that_hold_no_frames_are_refused(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DatasetError, match=said):
        open_recording(tmp_path / name)


def test_a_missing_recording_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="none: no such folder: give a folder of images"):
        open_recording(tmp_path / "none")
