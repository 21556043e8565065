"""A sensor whose outer beads lie beside the opening's dark edge, with the true places of its beads."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import load_calibration, save_calibration
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import PressDataset, read_dataset
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.geometry.points import distances
from palpate_edge.vision.tracker import Tracker
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, Shot, single_presses, write_dataset
from palpate_twin.dome.library import load_library

SEED, PLAN = 7207, Plan(train=30, test=15)


@dataclass(frozen=True)
class Twin:
    view: CameraView
    shots: tuple[Shot, ...]
    dataset: PressDataset
    calibration: Calibration


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    folder = tmp_path_factory.mktemp("edge") / "dataset"
    view = CameraView(random_sensor(SEED), load_library())
    shots = tuple(single_presses(view, PLAN, SEED))
    write_dataset(folder, view, shots, PLAN.references, SEED)
    dataset = read_dataset(folder)
    return Twin(view, shots, dataset, calibrate(dataset, dome=load_dome_model()))


def test_the_beads_beside_the_edge_are_fitted(twin: Twin) -> None:
    fitted = twin.calibration.fitted_beads
    assert isinstance(fitted, tuple)
    rest_px = twin.calibration.reference().position_px
    far = np.linalg.norm(rest_px - rest_px.mean(axis=0), axis=1)
    outer = {bead.bead for bead in fitted if far[bead.bead] > 0.95 * far.max()}
    assert len(outer) >= 6


def test_their_places_follow_the_skin(twin: Twin) -> None:
    """Errors by the renderer's outlines, of presses that the choice has not seen."""
    fitted = twin.calibration.reference()
    assert fitted.fit_offset_px is not None
    chosen = np.isfinite(fitted.fit_offset_px[:, 0])
    plain = replace(
        fitted, position_px=fitted.position_px - np.nan_to_num(fitted.fit_offset_px), fit_offset_px=None
    )
    true_rest_px, _ = twin.view.outlines(None)
    bead_of = distances(fitted.position_px, true_rest_px).argmin(axis=1)
    squares = []
    for shot, press in zip(twin.shots, twin.dataset.presses, strict=True):
        if shot.split != "test" or shot.press is None:
            continue
        true_px = twin.view.outlines(twin.view.dome.press(shot.press))[0]
        moved_px = (true_px - true_rest_px)[bead_of]
        image = read_image(twin.dataset.path(press))
        for number, reference in enumerate((plain, fitted)):
            beads = Tracker(reference).follow_image(image, twin.calibration.appearance)
            off_px = beads.position_px - reference.position_px - moved_px
            counts = chosen & beads.found
            squares.append((number, float((off_px[counts] ** 2).mean())))
    by_centroid, by_fit = (np.mean([one for which, one in squares if which == number]) for number in (0, 1))
    print(f"{chosen.sum()} beads: {by_centroid**0.5:.2f} px off as centroids, {by_fit**0.5:.2f} px as fitted")
    assert by_fit < 0.25 * by_centroid


def test_the_calibration_file_keeps_them(twin: Twin, tmp_path: Path) -> None:
    save_calibration(twin.calibration, tmp_path / "edge.cal")
    loaded = load_calibration(tmp_path / "edge.cal")
    assert loaded.fitted_beads == twin.calibration.fitted_beads
    np.testing.assert_array_equal(
        loaded.reference().fit_offset_px, twin.calibration.reference().fit_offset_px
    )
    without = msgspec.structs.replace(twin.calibration, fitted_beads=msgspec.UNSET)
    assert without.reference().fit_offset_px is None
