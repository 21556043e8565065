"""A hundred thousand frames in one process (2,000 without --effort=full): nothing grows."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.estimator import Estimator

REDUCED, FULL, WARM_UP = 2_000, 100_000, 1_000
MOST_GROWTH_BYTES = 4_000_000  # 40 bytes a frame: one small object kept from each would be more


def resident_bytes():
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def test_a_hundred_thousand_frames_leave_nothing_behind(shared_data, sample_calibration, effort):
    """Recorded frames in a loop: touches, sheared and rolling, and pauses; the clock goes on."""
    count = effort(REDUCED, FULL)
    estimator = Estimator(sample_calibration)
    sequence = read_dataset(shared_data("press-sequences/finger-1"))
    frames = [Frame(read_image(sequence.path(p), grey=True), 0, 0, "") for p in sequence.presses]
    before = 0
    for number in range(count):
        if number == WARM_UP:
            before = resident_bytes()
        frame = msgspec.structs.replace(
            frames[number % len(frames)], sequence=number, exposed_at_us=33_333 * number
        )
        estimator.estimate(frame)
    assert resident_bytes() - before < MOST_GROWTH_BYTES
    assert estimator.health.frames == count
    assert estimator.health.refused < 0.02 * count
