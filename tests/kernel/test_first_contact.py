"""First contact as docs/building.md has it, with a camera of the kernel that shows the twin's dome."""

from __future__ import annotations

import faulthandler
import itertools
import math
import sys
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import pytest
from tests.first_contact import OUTER_RADIUS_MM, contacts, walk

from kernel_guest.looped_camera import looped_camera
from palpate_edge.common.arrays import Image

pytestmark = pytest.mark.vm

PROJECT = Path(__file__).resolve().parents[2]
RECORDING = PROJECT / "demo" / "recording" / "finger-1" / "frames.webm"
PERIOD_S = 0.2


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """Return a folder with the commands, which find the entry points, as an installation makes it."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    metadata = tmp_path / "site" / "palpate-0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: palpate\nVersion: 0\n")
    (metadata / "entry_points.txt").write_text(
        "".join(
            f"[{group}]\n" + "".join(f"{name} = {target}\n" for name, target in entries.items())
            for group, entries in project["entry-points"].items()
        )
    )
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, target in project["scripts"].items():
        start = f"PYTHONPATH={metadata.parent}:$PYTHONPATH exec {sys.executable} -m {target.split(':')[0]}"
        (folder / name).write_text(f'#!/bin/sh\n{start} "$@"\n')
        (folder / name).chmod(0o755)
    return folder


def recorded() -> Iterator[Image]:
    """Yield the recording's pictures; the first is that of the untouched dome."""
    video = cv2.VideoCapture(str(RECORDING))
    while (picture := video.read()[1]) is not None:
        yield picture


@contextmanager
def dome_before(show: Callable[[Image], None], calibration: Path) -> Iterator[None]:
    """Show the camera an untouched dome until it is calibrated, then the recording again and again."""
    ended = threading.Event()
    untouched = next(recorded())

    def play() -> None:
        while not calibration.exists() and not ended.is_set():
            show(untouched)
            time.sleep(PERIOD_S)
        for picture in itertools.chain.from_iterable(recorded() for _ in itertools.count()):
            if ended.wait(PERIOD_S):
                return
            show(picture)

    player = threading.Thread(target=play)
    player.start()
    try:
        yield
    finally:
        ended.set()
        player.join()


def test_first_contact_works_as_written_with_a_camera(programs: Path, tmp_path: Path) -> None:
    """From an empty folder to contacts on the dome's surface; no file is edited, no camera is named."""
    faulthandler.cancel_dump_traceback_later()  # the walk lasts longer than a test that hangs
    folder = tmp_path / "empty"
    folder.mkdir()
    with looped_camera(640, 480) as (camera, show), dome_before(show, folder / "finger-1.cal"):
        screen = walk(folder, programs, limit_s=600)
    assert f'path = "{camera}"' in (folder / "finger-1.toml").read_text()
    places = contacts(screen)
    touched = [place for place in places if any(place)]
    assert len(touched) > 10, screen
    assert all(math.hypot(*place) == pytest.approx(OUTER_RADIUS_MM, abs=0.1) for place in touched)
