"""Any picture through bead search and layout learning: beads, or a typed error in one line."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.common.errors import PalpateError
from palpate_edge.diagnostics.video_tracking import reference_from
from palpate_edge.geometry.marker_layout import learn_layout
from palpate_edge.geometry.sensor import Camera, Dome, Markers, Ring, Sensor
from palpate_edge.vision.registration import register
from palpate_edge.vision.unknown_layout import beads_without_layout

DIAMETERS = st.one_of(st.none(), st.sampled_from([0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 1000.0]))
FUZZ = settings(deadline=None, max_examples=20)


def drawn(height, width, seed, kind):
    """A picture of one kind: noise, disks, boxes, a grid of disks, one huge disk, both disks and boxes."""
    random = np.random.default_rng(seed)
    picture = np.full((height, width, 3), random.integers(0, 256, 3), np.uint8)
    if kind == "noise":
        return random.integers(0, 256, picture.shape).astype(np.uint8)
    if kind in ("disks", "both"):
        for x, y, radius, *colour in random.integers(0, (width, height, 12, 256, 256, 256), (40, 6)).tolist():
            cv2.circle(picture, (x, y), radius, colour, -1)
    if kind in ("boxes", "both"):
        for x, y, right, low, *colour in random.integers(
            0, (width, height, width, height, 256, 256, 256), (12, 7)
        ).tolist():
            cv2.rectangle(picture, (x, y), (right, low), colour, -1)
    if kind == "grid":
        pitch = int(random.integers(6, 30))
        for y in range(0, height, pitch):
            for x in range(0, width, pitch):
                cv2.circle(picture, (x, y), max(1, pitch // int(random.integers(2, 5))), (9, 9, 9), -1)
    if kind == "huge":
        cv2.circle(picture, (width // 2, height // 2), max(1, min(height, width) // 2), (0, 0, 0), -1)
    return picture


PICTURES = st.builds(
    drawn,
    st.integers(1, 130),
    st.integers(1, 130),
    st.integers(0, 2**32),
    st.sampled_from(["noise", "disks", "boxes", "both", "grid", "huge"]),
)


@FUZZ
@given(PICTURES, DIAMETERS, st.booleans())
@pytest.mark.long
def test_any_picture_gives_beads_in_it_or_none(picture, diameter_px, grey):
    image = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if grey else picture
    blobs, _, size_px = beads_without_layout(image, diameter_px)
    height, width = image.shape[:2]
    assert len(blobs.strength) == len(blobs.position_px) == len(np.unique(blobs.position_px, axis=0))
    assert ((blobs.position_px >= 0) & (blobs.position_px < (width, height))).all()
    assert size_px > 0
    try:
        reference, _ = reference_from(image, diameter_px)
    except PalpateError as error:
        assert "no beads found" in str(error)
        return
    assert reference.neighbourhood.spacing_px.min() > 0
    assert np.isfinite(reference.neighbourhood.relative).all()


@FUZZ
@given(PICTURES.filter(lambda picture: min(picture.shape[:2]) >= 16), st.booleans(), st.floats(0.1, 20.0))
@pytest.mark.long
def test_any_picture_is_registered_or_refused(picture, drawn_rings, diameter_mm):
    height, width = picture.shape[:2]
    rings = (Ring(0, 1), Ring(20, 6), Ring(40, 12)) if drawn_rings else ()
    camera = Camera(width, height, (0.6 * width, 0.6 * width, width / 2, height / 2), (0.0, 0.0, -45.0))
    try:
        found = register(picture, Sensor(Dome(30.0, 5.0), Markers(26.5, diameter_mm, rings), camera))
    except PalpateError as error:
        assert "\n" not in str(error)
        return
    assert np.isfinite(found.position_px).all()


@FUZZ
@given(
    st.integers(0, 80),
    st.integers(0, 2**32),
    st.sampled_from(["any", "one place", "line", "coarse", "lattice"]),
)
def test_any_points_make_a_layout_or_are_refused(count, seed, kind):
    points = np.random.default_rng(seed).uniform((200, 120), (440, 360), (count, 2))
    if kind == "one place":
        points[:] = 240.0
    elif kind == "line":
        points[:, 1] = 240.0
    elif kind == "coarse":
        points = 20 * np.rint(points / 20)
    elif kind == "lattice":
        points = np.unique(20 * np.rint(points / 20), axis=0)
    camera = Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0))
    try:
        layout = learn_layout(camera, 26.5, points)
    except PalpateError as error:
        assert "\n" not in str(error)
        assert "nan" not in str(error)
        return
    assert np.isfinite(layout.position_mm).all()
    assert sorted(layout.order) == list(range(len(points)))
