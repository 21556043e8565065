"""The sources of a view's statuses and pictures: a recording, or a running host."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path

from palpate_edge.common.signals import stop_event
from palpate_host.common.camera_source import CameraSource
from palpate_host.common.status import HostStatus
from palpate_host.recording.status_follower import StatusFollower
from palpate_host.view.camera_beads import CameraBeads
from palpate_host.view.cameras import LiveCamera, recorded_pictures
from palpate_host.view.hand_view import HandView

WAIT_S = 0.02


def show_recording(
    view: HandView,
    statuses: Iterable[HostStatus],
    cameras: Sequence[CameraSource],
    beads: Mapping[str, CameraBeads],
) -> int:
    """Show a whole recording; return its number of ticks. beads: camera -> its beads."""
    ticks = 0
    for status in statuses:
        view.add(status)
        ticks += 1
    for camera in cameras:
        for exposed_us, picture in recorded_pictures(camera, beads.get(camera.name)):
            view.add_picture(camera.name, exposed_us, picture)
    return ticks


def show_live(
    view: HandView,
    socket_path: Path,
    cameras: Sequence[CameraSource],
    beads: Mapping[str, CameraBeads],
    duration_s: float | None,
) -> int:
    """Show a running host until SIGTERM, SIGINT or for `duration_s`; return the number of ticks.

    beads: camera -> its beads.
    """
    ticks = 0
    end_s = None if duration_s is None else time.monotonic() + duration_s
    with ExitStack() as stack:
        live = [
            stack.enter_context(closing(LiveCamera(camera, beads.get(camera.name)))) for camera in cameras
        ]
        follower = stack.enter_context(StatusFollower(socket_path))
        stopped = stack.enter_context(stop_event())
        while not stopped.wait(WAIT_S) and (end_s is None or time.monotonic() < end_s):
            for status in follower.take():
                view.add(status)
                ticks += 1
            for camera in live:
                if (taken := camera.take()) is not None:
                    view.add_picture(camera.name, *taken)
    return ticks
