"""Recordings of frames: a bounded ring of whole files that plays again."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.common.errors import CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.recorder import FrameRing, Recorder, RingLimits
from palpate_edge.datasets.recording import all_frames, open_recording

LARGE = RingLimits(bytes=10**9, seconds=1000.0)
PERIOD_US = 20_000  # 50 frames/s


def noisy(sequence):
    image = np.random.default_rng(sequence).integers(0, 255, (48, 64), dtype=np.uint8)
    return Frame(image, 1_700_000_000_000_000 + PERIOD_US * sequence, sequence, f"camera#{sequence}")


def names(folder):
    return sorted(path.name for path in folder.glob("*.png"))


def test_it_plays_again_bit_for_bit_and_at_its_rate(tmp_path):
    ring = FrameRing(tmp_path / "r", LARGE)
    for sequence in range(5, 12):
        ring.add(noisy(sequence))
    ring.write_index()
    recording = open_recording(tmp_path / "r")
    assert recording.fps == 50.0
    played = [frame.image for frame in all_frames(recording)]
    assert len(played) == 7
    assert all(np.array_equal(image, noisy(5 + i).image) for i, image in enumerate(played))


def test_frames_that_were_missed_do_not_change_the_rate(tmp_path):
    ring = FrameRing(tmp_path / "r", LARGE)
    for sequence in (0, 1, 5, 6, 7, 20):
        ring.add(noisy(sequence))
    ring.write_index()
    assert open_recording(tmp_path / "r").fps == 50.0


def test_the_seconds_bound_it(tmp_path):
    ring = FrameRing(tmp_path / "r", RingLimits(bytes=10**9, seconds=0.1))
    for sequence in range(20):
        ring.add(noisy(sequence))
    assert names(tmp_path / "r") == [f"{sequence:010}.png" for sequence in range(14, 20)]


def test_the_bytes_bound_it(tmp_path):
    ring = FrameRing(tmp_path / "r", RingLimits(bytes=20_000, seconds=1000.0))
    for sequence in range(20):
        ring.add(noisy(sequence))
        assert sum(path.stat().st_size for path in (tmp_path / "r").glob("*.png")) <= 20_000
    assert 4 <= len(names(tmp_path / "r")) <= 7  # noise of 3 kB each
    assert names(tmp_path / "r")[-1] == "0000000019.png"


def test_what_a_killed_recorder_left_half_written_is_never_a_frame(tmp_path):
    ring = FrameRing(tmp_path / "r", LARGE)
    ring.add(noisy(1))
    whole = (tmp_path / "r" / "0000000001.png").read_bytes()
    (tmp_path / "r" / ".0000000002.png.77.tmp").write_bytes(whole[:500])
    assert [name for _, name in (open_recording(tmp_path / "r").read(0),)] == ["0000000001.png"]
    assert open_recording(tmp_path / "r").count == 1


def test_a_folder_with_frames_is_not_mixed(tmp_path):
    FrameRing(tmp_path / "r", LARGE).add(noisy(1))
    with pytest.raises(CaptureError, match="has frames already"):
        FrameRing(tmp_path / "r", LARGE)


def test_a_place_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(CaptureError, match="no recording in"):
        Recorder(tmp_path / "file", LARGE).start("r")


def test_the_recorder_writes_what_it_is_offered_while_it_records(tmp_path):
    recorder = Recorder(tmp_path, LARGE)
    recorder.offer(noisy(0))
    folder = recorder.start("r")
    for sequence in range(1, 6):
        recorder.offer(noisy(sequence))
    recorder.stop()
    recorder.offer(noisy(6))
    recorder.close()
    assert names(folder) == [f"{sequence:010}.png" for sequence in range(1, 6)]
    assert (folder / "frames.csv").read_text().splitlines()[1].startswith("0000000001.png,1700000000020000,1")
    assert (recorder.written, recorder.left_out, recorder.failure) == (5, 0, "")
    assert not recorder.is_recording


def test_a_disk_that_fails_ends_the_recording_with_a_reason(tmp_path):
    recorder = Recorder(tmp_path, LARGE)
    folder = recorder.start("r")
    folder.rmdir()
    recorder.offer(noisy(1))
    recorder.close()
    assert "cannot be written" in recorder.failure
    assert recorder.written == 0
