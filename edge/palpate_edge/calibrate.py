"""Press dataset -> Calibration: layout and camera from the reference frames, the rest from the presses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration import Bead, Calibration, Source
from palpate_edge.contact import PaperModel, fit_paper_model, raw_contact
from palpate_edge.dataset import Press, PressDataset
from palpate_edge.displacement import DisplacementReader
from palpate_edge.errors import CalibrationError
from palpate_edge.first_sight import FirstSight, first_sight
from palpate_edge.images import read_image
from palpate_edge.markers import Image, Refiner, plane
from palpate_edge.motion import SkinMotion
from palpate_edge.sensor import View, bead_layout_mm
from palpate_edge.tracking import Beads, Reference, Tracker
from palpate_edge.virtual_points import VirtualPointMesh

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]  # done, total

MIN_PRESS_FORCE_N = 0.1  # lighter presses say nothing about place or stiffness
THRESHOLD_OVER_NOISE = 2.0  # contact threshold over the largest motion seen without contact
THRESHOLD_FLOOR_PX = 0.02
MIN_MODEL_PRESSES = 10
TRAINING_STEPS = 100  # of the progress bar


def calibrate(
    dataset: PressDataset, progress: Progress = lambda _done, _total: None, *, with_model: bool = True
) -> Calibration:
    """Calibrate one sensor with its reference frames and the train split of its presses, if any.

    with_model: train the correction model too, if there are `MIN_MODEL_PRESSES` presses for it (extra
    ``train``). Raises CalibrationError where the reference frames do not show the layout, DatasetError for
    bad files.
    """
    presses = dataset.split("train")
    total = len(dataset.reference) + len(presses) + TRAINING_STEPS
    sight = first_sight(_read(dataset, dataset.reference[0]), dataset.sensor)
    reference, rest_motion = _measure_reference(dataset, sight, lambda done: progress(done, total))
    tracker, skin = Tracker(reference), SkinMotion(reference)
    ring_of = bead_layout_mm(dataset.sensor.markers)[1]
    mesh = VirtualPointMesh(reference.position_px, ring_of)
    view = View(dataset.sensor.camera, sight.pose)
    touches: list[tuple[Press, Beads]] = []
    for number, press in enumerate(presses, start=1):
        beads = tracker.follow(plane(_read(dataset, dataset.path(press)), sight.appearance))
        if press.position_mm is None:
            rest_motion.append(skin.size_px(beads))
        else:
            touches.append((press, beads))
        progress(len(dataset.reference) + number, total)
    threshold_px = max(THRESHOLD_FLOOR_PX, THRESHOLD_OVER_NOISE * max(rest_motion))
    touches = [(press, beads) for press, beads in touches if skin.size_px(beads) > threshold_px]
    model = b""
    if with_model and len(touches) >= MIN_MODEL_PRESSES:
        reader = DisplacementReader(reference.position_px, view, dataset.sensor.markers.radius_mm)
        model = _train(dataset, reader, touches, lambda done: progress(total - TRAINING_STEPS + done, total))
    expected_px = view.project(bead_layout_mm(dataset.sensor.markers)[0])
    progress(total, total)
    return Calibration(
        sensor=dataset.sensor,
        pose=sight.pose,
        appearance=sight.appearance,
        beads=_beads(reference, ring_of),
        contact_threshold_px=threshold_px,
        paper=_fit(touches, mesh, view, dataset.sensor.markers.radius_mm),
        residual_px=float(np.sqrt(((expected_px - reference.position_px) ** 2).sum(axis=1).mean())),
        source=Source(dataset.folder.resolve().name, len(dataset.reference), len(touches)),
        model=model,
    )


def _read(dataset: PressDataset, path: Path) -> Image:
    """An image of the size that the dataset's description says."""
    image = read_image(path)
    width, height = dataset.sensor.image_size_px
    if image.shape[:2] != (height, width):
        raise CalibrationError(
            f"{path} is {image.shape[1]}x{image.shape[0]}, sensor.toml says {width}x{height}: "
            "correct one of them"
        )
    return image


def _measure_reference(
    dataset: PressDataset, sight: FirstSight, progress: Callable[[int], None]
) -> tuple[Reference, list[float]]:
    """Median place, contrast and area of each bead over the reference frames, and each frame's motion."""
    refiner = Refiner(sight.diameter_px)
    position, contrast, area = [], [], []
    for number, path in enumerate(dataset.reference, start=1):
        dark = plane(_read(dataset, path), sight.appearance)
        refined = refiner.refine(dark, sight.position_px)
        position.append(refined.position_px)
        contrast.append(refined.contrast)
        area.append(refined.area)
        progress(number)
    reference, measured = _reference(sight, np.array(position), np.array(contrast), np.array(area))
    skin = SkinMotion(reference)
    motion = [skin.size_px(Beads(frame, measured, False)) for frame in position]
    return reference, motion


def _reference(
    sight: FirstSight, position_px: Array, contrast: Array, area: Array
) -> tuple[Reference, NDArray[np.bool_]]:
    """Medians over the frames (f, n[, 2]), and which beads were really measured.

    A bead that the first frame does not show stands where the layout has it and is given the others' looks,
    so that it counts as lost until a bead appears there.
    """
    contrast, area = np.median(contrast, axis=0), np.median(area, axis=0)
    measured = np.asarray(sight.seen & (contrast > 0) & (area > 0))
    if not measured.any():
        raise CalibrationError("no bead lies wholly inside the reference frames: check camera.matrix")
    place = np.where(measured[:, None], np.median(position_px, axis=0), sight.position_px)
    contrast = np.where(measured, contrast, np.median(contrast[measured]))
    area = np.where(measured, area, np.median(area[measured]))
    return Reference(place, sight.diameter_px, contrast, area), measured


def _fit(
    touches: list[tuple[Press, Beads]], mesh: VirtualPointMesh, view: View, radius_mm: float
) -> PaperModel:
    """The paper's correction function and stiffness from presses of known place and force."""
    firm = [(press, beads) for press, beads in touches if press.normal_force_N >= MIN_PRESS_FORCE_N]
    raw = [
        raw_contact(mesh, mesh.points(beads.position_px, beads.found), view, radius_mm) for _, beads in firm
    ]
    places = np.array([press.position_mm for press, _ in firm], dtype=np.float64).reshape(-1, 3)
    return fit_paper_model(
        theta_raw=np.array([contact.theta_rad for contact in raw]),
        theta_true=np.arctan2(np.hypot(places[:, 0], places[:, 1]), places[:, 2]),
        spread_px=np.array([contact.spread_px for contact in raw]),
        force_N=np.array([press.normal_force_N for press, _ in firm]),
    )


def _train(
    dataset: PressDataset,
    reader: DisplacementReader,
    touches: list[tuple[Press, Beads]],
    progress: Callable[[int], None],
) -> bytes:
    """The correction model's ONNX file."""
    from palpate_edge.training.kernel_ridge import fit  # noqa: PLC0415 - extra `train`
    from palpate_edge.training.onnx_export import export  # noqa: PLC0415
    from palpate_edge.training.samples import TrainingPress, make_samples  # noqa: PLC0415

    presses = [
        TrainingPress(
            beads, np.array(press.position_mm) / np.linalg.norm(press.position_mm), np.array(press.force_N)
        )
        for press, beads in touches
        if press.position_mm is not None
    ]
    samples = make_samples(reader, presses)
    regression = fit(
        samples,
        dataset.sensor.dome.outer_radius_mm,
        lambda done, steps: progress(TRAINING_STEPS * done // steps),
    )
    return export(regression, dataset.sensor.fingerprint(), samples)


def _beads(reference: Reference, ring_of: NDArray[np.intp]) -> tuple[Bead, ...]:
    columns = (reference.position_px, reference.diameter_px, reference.contrast, reference.area, ring_of)
    return tuple(
        Bead(float(place[0]), float(place[1]), float(diameter), float(contrast), float(area), int(ring))
        for place, diameter, contrast, area, ring in zip(*columns, strict=True)
    )
