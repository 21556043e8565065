"""Torn frames are those whose labels jump by a row, not those that slipped or miss markers."""

from __future__ import annotations

import numpy as np
from bench.pose_tears import torn_frames

COLUMN, ROW = np.meshgrid(np.arange(9), np.arange(9))
REST = 20.0 * np.stack([COLUMN.ravel(), ROW.ravel()], axis=1)


def test_only_the_frame_with_rows_one_off_is_torn():
    poses = np.random.default_rng(4).uniform(-1, 1, (400, 2))
    displacement = np.repeat(15.0 * poses[:, None], len(REST), axis=1)
    found = np.ones((400, len(REST)), dtype=np.bool_)
    displacement[7, :36] += [0, 20.0]  # four rows bear the numbers of the next ones
    displacement[8] += 0.9 * REST[:, ::-1] / 10  # slipped: far from its pose, but smooth
    displacement[9, 40] += 15.0  # a speck taken for one marker
    displacement[10, 36:] += 40.0  # not found
    found[10, 36:] = False
    assert np.flatnonzero(torn_frames(REST, displacement, found, poses)).tolist() == [7]
