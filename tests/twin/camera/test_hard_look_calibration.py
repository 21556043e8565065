"""Calibration under looks that other data sets do not have: haze, JPEG 60, room light that changes.

The twin's own bead places are the truth.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

from palpate_edge.calibration.measurement import measure
from palpate_edge.common.arrays import Array
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.vision.registration import register, register_best
from palpate_twin.camera.hard_looks import with_properties
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, single_presses, write_dataset
from palpate_twin.dome.library import load_library

PRESSES = 16


def view_of(layout: str, seed: int, *look: str) -> CameraView:
    twin = random_sensor(seed, layout)
    return CameraView(msgspec.structs.replace(twin, look=with_properties(twin.look, look)), load_library())


def apart_px(places: Array, others: Array) -> Array:
    """Return the distances (n, m)."""
    return np.linalg.norm(places[:, None] - others[None], axis=2)


@pytest.mark.long
def test_a_layout_is_learned_from_the_frames_that_show_it() -> None:
    """Room light hides a third of the beads in the first of these frames."""
    view = view_of("hexagonal-61", 306, "room-light", "bead_bgr=black", "skin_bgr=skin")
    rng = np.random.default_rng(306)
    well_lit, first, other = (view.frame(None, rng)[0] for _ in range(3))
    found = register_best([first, other, well_lit], view.twin.sensor)
    assert len(found.position_px) >= 60
    assert (apart_px(found.position_px, view.outlines(None)[0]).min(axis=1) < 3).all()


@pytest.mark.long
def test_hidden_beads_of_a_declared_hexagon_are_placed_by_the_others() -> None:
    """Ten beads of 127 are painted over, three of them in the outermost shell."""
    view = view_of("tactip-127", 2102)
    true_px = view.outlines(None)[0]
    outwards = np.argsort(np.linalg.norm(true_px - true_px.mean(axis=0), axis=1))
    hidden = outwards[[0, 9, 20, 33, 47, 62, 80, 95, 110, 126]]
    image = view.frame(None, np.random.default_rng(1))[0]
    mask = np.zeros(image.shape[:2], np.uint8)
    for x, y in np.rint(true_px[hidden]).astype(int).tolist():
        cv2.circle(mask, (x, y), 14, 255, cv2.FILLED)
    image = np.asarray(cv2.inpaint(image, mask, 3, cv2.INPAINT_TELEA), np.uint8)
    sensor = view.twin.sensor
    declared = msgspec.structs.replace(sensor.markers, rings=(), count=127, layout="hexagonal")
    found = register(image, msgspec.structs.replace(sensor, markers=declared))
    apart = apart_px(found.position_px, true_px)
    assert sorted(apart.argmin(axis=1)) == list(range(127))
    assert int(found.seen.sum()) == 117
    spacing_px = np.sort(apart_px(true_px, true_px), axis=1)[:, 1]
    assert (apart.min(axis=1)[~found.seen] < 0.25 * spacing_px.mean()).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("layout", "seed", "colour"), [("1+6+12+18+24+24", 301, "black"), ("1+8x13", 305, "red")]
)
def test_beads_behind_a_veil_are_found_and_placed(
    layout: str, seed: int, colour: str, tmp_path: Path
) -> None:
    """Of black beads 96 % were found, with errors of 2 px; red ones were 0.4 px off."""
    view = view_of(layout, seed, "veil", f"bead_bgr={colour}", "skin_bgr=grey")
    shots = single_presses(view, Plan(PRESSES, 0, hide=12), seed)
    write_dataset(tmp_path / "dome", view, shots, 6, seed)
    dataset = read_dataset(tmp_path / "dome")
    measured = measure(dataset, dataset.split("train"))
    rest_px = view.outlines(None)[0]
    bead_of = apart_px(measured.reference.position_px, rest_px).argmin(axis=1)
    true_px = {
        press.frame: view.outlines(view.dome.press(shot.press))[0][bead_of] - rest_px[bead_of]
        for press, shot in zip(dataset.split("train"), shots, strict=True)
        if shot.press is not None
    }
    hidden = {press.frame: shot.hidden for press, shot in zip(dataset.split("train"), shots, strict=True)}
    off_px, found, visible = [], 0, 0
    for press, beads in measured.touches:
        seen = ~np.isin(bead_of, hidden[press.frame])
        assert not beads.found[~seen].any()
        found, visible = found + beads.found[seen].sum(), visible + seen.sum()
        moved_px = beads.position_px - measured.reference.position_px
        off_px.append(np.linalg.norm(moved_px - true_px[press.frame], axis=1)[beads.found])
    assert len(measured.touches) >= PRESSES - 1
    assert found > 0.985 * visible
    assert np.quantile(np.concatenate(off_px), 0.9) < 0.3
    assert measured.threshold_px < 0.06
