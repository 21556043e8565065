"""Frames through shared memory between real processes: never torn, never waiting, a dead writer noticed."""

from __future__ import annotations

import signal
import struct
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from palpate_edge.capture import shared_memory
from palpate_edge.capture.frame_ring import RingFormat, RingReader, RingWriter
from palpate_edge.capture.shared_memory import SharedMemorySource
from palpate_edge.common.errors import CaptureError
from palpate_edge.common.local_clock import monotonic_us
from palpate_edge.geometry.sensor import Camera, Dome, Markers, Sensor

FORM = RingFormat(64, 48, 3, slots=2)
SENSOR = Sensor(
    Dome(30.0, 5.0), Markers(26.5, 3.0), Camera(64, 48, (38.0, 38.0, 32.0, 24.0), (0.0, 0.0, -45.0))
)

# Every pixel of frame n is n % 251, so that a mixture of two frames shows.
WRITER = textwrap.dedent("""
    import sys, time
    from pathlib import Path
    import numpy as np
    from palpate_edge.capture.frame_ring import RingFormat, RingWriter
    path, width, height, pause_s = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
    form = RingFormat(width, height, 3, slots=2)
    writer, number = RingWriter(path, form), 0
    print("ready", flush=True)
    while True:
        writer.write(np.full(form.shape, number % 251, np.uint8), number, time.monotonic_ns() // 1000)
        number += 1
        time.sleep(pause_s)
""")


@contextmanager
def _writer(path: Path, width: int, height: int, pause_s: float) -> Generator[subprocess.Popen[str]]:
    arguments = [sys.executable, "-c", WRITER, str(path), str(width), str(height), str(pause_s)]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


def _image(value: int) -> np.ndarray:
    return np.full(FORM.shape, value, np.uint8)


def test_a_reader_gets_what_was_written_and_only_the_newest(tmp_path: Path) -> None:
    path = tmp_path / "ring"
    writer = RingWriter(path, FORM)
    writer.write(_image(1), 0, 100)
    reader = RingReader(path)
    assert reader.format == FORM
    assert reader.newest() is None  # written before it was opened
    picture = np.random.default_rng(0).integers(0, 256, FORM.shape, dtype=np.uint8)
    writer.write(_image(2), 5, 200)
    writer.write(picture, 7, 300)
    frame = reader.newest()
    assert frame is not None
    assert (frame.sequence, frame.exposed_at_us) == (7, 300)
    writer.write(_image(9), 8, 400)
    writer.write(_image(9), 9, 500)
    assert np.array_equal(frame.image, picture)  # a copy of its own
    assert reader.newest() is not None
    assert reader.newest() is None
    reader.close()
    writer.close()
    assert not path.exists()


def test_no_frame_is_torn_by_a_writer_that_never_waits(tmp_path: Path) -> None:
    """Two slots, large frames, a writer without a pause: most copies are overtaken, none may be mixed."""
    with _writer(tmp_path / "ring", 320, 240, 0.0):
        reader = RingReader(tmp_path / "ring")
        seen, deadline_s = [], time.monotonic() + 60
        overtaken = False  # on a loaded processor the two may take turns for a while
        while (len(seen) < 300 or not overtaken) and time.monotonic() < deadline_s:
            frame = reader.newest()
            if frame is not None:
                assert (frame.image == frame.sequence % 251).all()
                overtaken |= bool(seen) and frame.sequence > seen[-1] + 1
                seen.append(frame.sequence)
        reader.close()
    assert len(seen) >= 100
    assert (np.diff(seen) > 0).all()
    assert np.diff(seen).max() > 1  # it did overtake


def test_writes_cut_off_at_any_byte_never_come_out(tmp_path: Path) -> None:
    """The file as a writer that was killed leaves it: each state of the stamps and half-written pixels."""
    path = tmp_path / "ring"
    writer = RingWriter(path, FORM)
    rng = np.random.default_rng(1)
    at = 64 + FORM.slot_bytes  # the slot of frame 1
    for number in range(200):
        writer.write(_image(7), number, number)
        if number % 2:
            continue
        reader = RingReader(path)
        half = rng.integers(0, 256, int(rng.integers(1, FORM.frame_bytes)), dtype=np.uint8).tobytes()
        with path.open("r+b") as file:
            file.seek(at)
            file.write(struct.pack("<Q", 2 * (number + 1) + 1))
            file.seek(at + 64)
            file.write(half)
        assert reader.newest() is None
        with path.open("r+b") as file:  # count first, as no writer does: the stamp alone must hold
            file.seek(48)
            file.write(struct.pack("<Q", number + 2))
        assert reader.newest() is None
        reader.close()
    writer.close()


def test_a_killed_writer_is_a_stall_and_the_next_one_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared_memory, "STALLED_AFTER_S", 0.2)
    path = tmp_path / "ring"
    for _ in range(3):
        with _writer(path, 64, 48, 0.001) as process:
            source = SharedMemorySource(path, SENSOR, lambda stamp_us: stamp_us)
            before = source.read()
            assert before is not None
            process.send_signal(signal.SIGKILL)  # wherever it is: its file stays
            process.wait()
            with pytest.raises(CaptureError, match=r"no frame for 0\.2 s"):
                for _ in range(3):  # the last one written may still be read
                    frame = source.read()
                    assert frame is not None
                    assert (frame.image == frame.sequence % 251).all()
            source.close()
        assert path.exists()


def test_a_reader_cannot_touch_the_writer_s_memory(tmp_path: Path) -> None:
    writer = RingWriter(tmp_path / "ring", FORM)
    (tmp_path / "ring").chmod(0o444)
    reader = RingReader(tmp_path / "ring")
    with pytest.raises((ValueError, TypeError)):
        reader._slots[0][0, 0] = 1
    reader.close()
    writer.close()


def test_a_writer_leaves_the_path_to_the_one_that_took_it(tmp_path: Path) -> None:
    path = tmp_path / "ring"
    first, second = RingWriter(path, FORM), RingWriter(path, FORM)
    reader = RingReader(path)
    first.write(_image(1), 0, 0)
    assert reader.newest() is None
    second.write(_image(2), 0, 0)
    frame = reader.newest()
    assert frame is not None
    assert (frame.image == 2).all()
    reader.close()
    first.close()
    assert path.exists()
    second.close()
    assert not path.exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a ring of frames"),
        (b"x" * 5000, "not a ring of frames"),
        (struct.pack("<8sIIIII", b"PALPRING", 9, 2, 64, 48, 3) + bytes(5000), "version 9"),
        (struct.pack("<8sIIIII", b"PALPRING", 1, 2, 64, 48, 3) + bytes(5000), "are inconsistent"),
        (struct.pack("<8sIIIII", b"PALPRING", 1, 0, 64, 48, 3) + bytes(5000), "are inconsistent"),
        (struct.pack("<8sIIIII", b"PALPRING", 1, 2, 0, 48, 3) + bytes(5000), "are inconsistent"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "ring"
    path.write_bytes(content)
    with pytest.raises(CaptureError, match=message):
        RingReader(path)


def test_a_ring_of_another_sensor_or_size_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "ring"

    def open_with(form: RingFormat) -> SharedMemorySource:
        writer = RingWriter(path, form)
        try:
            return SharedMemorySource(path, SENSOR, lambda stamp_us: stamp_us)
        finally:
            writer.close()

    with pytest.raises(CaptureError, match="32x48, the calibration is for 64x48"):
        open_with(RingFormat(32, 48, 3))
    with pytest.raises(CaptureError, match="frames of sensor 0123456789abcdef"):
        open_with(RingFormat(64, 48, 3, fingerprint="0123456789abcdef"))
    open_with(RingFormat(64, 48, 1, fingerprint=SENSOR.fingerprint())).close()
    with pytest.raises(CaptureError, match="is missing: start"):
        SharedMemorySource(path, SENSOR, lambda stamp_us: stamp_us)
    with pytest.raises(CaptureError, match="cannot be written: its folder does not exist"):
        RingWriter(tmp_path / "nowhere" / "ring", FORM)


def test_exposure_is_on_the_daemon_s_clock_and_gaps_are_dropped_frames(tmp_path: Path) -> None:
    path = tmp_path / "ring"
    writer = RingWriter(path, FORM)
    source = SharedMemorySource(path, SENSOR, lambda stamp_us: stamp_us + 1_000_000)
    for sequence in (3, 4, 9):
        writer.write(_image(sequence), sequence, 10 * sequence)
        frame = source.read()
        assert frame is not None
        assert (frame.sequence, frame.exposed_at_us) == (sequence, 1_000_000 + 10 * sequence)
        assert frame.name == f"ring#{sequence}"
    assert source.dropped == 4
    source.close()
    writer.close()


def test_a_stall_is_one_of_the_daemons_clock(tmp_path: Path) -> None:
    """A clock that goes 50 times slower than the machine's: what is silent for 0.6 s has not stalled yet."""
    path = tmp_path / "ring"
    writer = RingWriter(path, FORM)
    begin_us = monotonic_us()
    source = SharedMemorySource(
        path, SENSOR, lambda stamp_us: stamp_us, lambda: begin_us + (monotonic_us() - begin_us) // 50
    )
    late = threading.Timer(0.6, lambda: writer.write(np.full(FORM.shape, 7, np.uint8), 7, 7_000))
    late.start()
    frame = source.read()
    assert frame is not None and frame.sequence == 7
    late.join()
    source.close()
    writer.close()
