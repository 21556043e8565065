"""Pictures over ROS 2: from a ring in shared memory, by `palpate-host ros`, to a subscriber."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from tests.host.ros.conftest import HAND, Listener, stamp_us, wait_for

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.arrays import Image

FORM = RingFormat(width=160, height=120, channels=3)
PICTURES = 6
SPACING_US, TOLERANCE_US = 1_000_000, 100_000
JPEG_ERROR = 3.0  # of 255, mean; two of the pictures differ by 10 at least


def picture(number: int) -> Image:
    """Draw a ramp with a disk; the disk's place is the picture's number."""
    row, column = np.mgrid[0 : FORM.height, 0 : FORM.width]
    image = np.ascontiguousarray(np.stack([column, row, 255 - column], axis=2), dtype=np.uint8)
    cv2.circle(image, (25 + 20 * number, 60), 18, (0, 255, 0), -1)
    return image


@pytest.mark.ros
def test_a_subscriber_gets_the_rings_pictures_with_the_stamps_of_their_exposures(
    bridge, host, listener: Listener, tmp_path: Path
) -> None:
    """Exposures are 1 s apart and in the past, so that a stamp belongs to one picture."""
    from sensor_msgs.msg import CompressedImage

    pictures = [picture(number) for number in range(PICTURES)]
    ago_us = [SPACING_US * (PICTURES - number) for number in range(PICTURES)]
    unix_us, monotonic_us = time.time_ns() // 1000, time.monotonic_ns() // 1000
    received = listener.subscribe(CompressedImage, "finger_1/image_raw/compressed")

    def with_stamp(number: int) -> list[Any]:
        stamp = unix_us - ago_us[number]
        return [message for _, message in received if abs(stamp_us(message) - stamp) < TOLERANCE_US]

    with closing(RingWriter(tmp_path / "ring", FORM)) as ring:
        bridge(HAND, tmp_path / "host.sock", "--camera", f"finger-1={tmp_path / 'ring'}")

        def write_until_received(number: int) -> list[Any]:
            ring.write(pictures[number], number, monotonic_us - ago_us[number])
            return with_stamp(number)

        for number in range(PICTURES):
            wait_for(lambda number=number: write_until_received(number), f"picture {number}")

    assert sum(len(with_stamp(number)) for number in range(PICTURES)) == len(received)
    for number in range(PICTURES):
        for message in with_stamp(number):
            assert (message.format, message.header.frame_id) == ("jpeg", "tip_1")
            decoded = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
            errors = [np.abs(decoded.astype(float) - other).mean() for other in pictures]
            assert errors[number] < JPEG_ERROR
            assert errors[number] == min(errors)
