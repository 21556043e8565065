"""Pictures of a fingertip: the contact is drawn where it is, and only where there is one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.vision.beads import Beads
from palpate_host.common.tip_contact import TipContact
from palpate_twin.camera.kept_pictures import EVERY, LAST, PictureKeeper, kept_pictures
from palpate_twin.demo.fingertip_panels import bead_panel, dome_panel

SIDE = 300


def contact(position_mm, *, in_contact=True):
    return TipContact(
        received_at_us=0,
        exposed_at_us=0,
        sequence=0,
        latency_us=0,
        position_mm=position_mm,
        normal_force_N=0.1,
        shear_N=(0.0, 0.0),
        valid=True,
        in_contact=in_contact,
        slip=False,
        quality=100,
    )


def red(picture):
    """Mean place (x, y) of what is red, or None."""
    blue, green, red_part = (picture[..., channel].astype(int) for channel in range(3))
    rows, columns = np.nonzero((red_part > 180) & (blue < 120) & (green < 120))
    return None if len(rows) == 0 else np.array([columns.mean(), rows.mean()])


def test_the_contact_is_where_it_is_on_the_dome():
    """x is to the right; y is away from the eye, which is above by 35 degrees, so up in the picture."""
    places = [np.array(place) for place in ((0.0, 0.0, 30.0), (15.0, 0.0, 26.0), (0.0, -15.0, 26.0))]
    apex, right, near = (red(dome_panel(contact(tuple(place)), 30.0, SIDE)) for place in places)
    scale = 0.4 * SIDE / 30.0
    assert right[0] - apex[0] == pytest.approx(15 * scale, abs=3)
    assert abs(near[0] - apex[0]) < 1.5
    assert near[1] - apex[1] == pytest.approx((4 * np.cos(0.611) + 15 * np.sin(0.611)) * scale, abs=4)
    assert red(dome_panel(contact((0.0, 0.0, 30.0), in_contact=False), 30.0, SIDE)) is None


def test_a_lost_bead_is_a_red_cross(drawn_calibration):
    reference = drawn_calibration.reference()
    found = np.ones(len(reference.position_px), dtype=bool)
    width, height = drawn_calibration.sensor.image_size_px
    grey = np.full((height, width), 60, dtype=np.uint8)
    seen = bead_panel(grey, reference, Beads.from_positions(reference.position_px, found), height)
    assert red(seen) is None
    found[7] = False
    seen = bead_panel(grey, reference, Beads.from_positions(reference.position_px, found), height)
    assert red(seen) == pytest.approx(reference.position_px[7], abs=1.5)


def test_each_fifth_picture_is_kept_for_a_minute(tmp_path):
    keeper = PictureKeeper(tmp_path / "finger-1")
    for sequence in (0, 1, EVERY, 2 * EVERY + 1, LAST, LAST + EVERY):
        keeper.keep(sequence, np.full((8, 8, 3), sequence % 250, dtype=np.uint8))
    kept = kept_pictures(tmp_path / "finger-1")
    assert sorted(kept) == [0, EVERY, LAST]
    assert abs(int(cv2.imread(str(kept[EVERY])).mean()) - EVERY) <= 1
    assert kept_pictures(tmp_path / "none") == {}
