"""The pose model: presses of one or several sensors, from which a new one of their kind is calibrated."""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.npyio import NpzFile

from palpate_edge.common.arrays import Array
from palpate_edge.common.atomic_write import atomic_file
from palpate_edge.common.contact_quantities import POSE_LABELS
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.picture_sensor import LabelAxes

KIND = "palpate-pose-model"
DAMAGED = (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)
AGAIN = "make it again with palpate-edge train"


@dataclass(frozen=True, slots=True)
class PoseModel:
    """rest_px (n, 2): markers of the untouched sensor; displacement_px (s, 2 n); targets (s, k): a value for
    each of `labels`, about `axes` (None where they were not declared)."""

    rest_px: Array
    displacement_px: Array
    labels: tuple[str, ...]
    targets: Array
    axes: LabelAxes | None


def is_pose_model(path: Path) -> bool:
    """Return whether a file is a pose model; False when it cannot be read."""
    try:
        with path.open("rb") as opened, NpzFile(opened, allow_pickle=False) as file:
            return "kind" in file and str(file["kind"]) == KIND
    except DAMAGED:
        return False


def save_pose_model(model: PoseModel, path: Path) -> None:
    """Write a pose model, displacements in half precision. Raises CalibrationError."""
    axes = [] if model.axes is None else [model.axes.x_axis_deg, float(model.axes.motion_of == "sensor")]
    with atomic_file(path, CalibrationError) as file:
        np.savez_compressed(
            file,
            kind=np.array(KIND),
            rest=model.rest_px,
            displacement=model.displacement_px.astype(np.float16),
            labels=np.array(model.labels),
            targets=model.targets,
            axes=np.array(axes, dtype=np.float64),
        )


def load_pose_model(path: Path) -> PoseModel:
    """Read a pose model. Raises CalibrationError with the file, the fault and the way out."""
    if path.is_file() and not is_pose_model(path):
        raise CalibrationError(
            f"{path} is not a pose model: for a dataset of pose labels make one with palpate-edge train from "
            "pose datasets, or leave --dome-model out"
        )
    try:
        with path.open("rb") as opened, NpzFile(opened, allow_pickle=False) as file:
            labels = tuple(str(label) for label in file["labels"])
            rest, displacement, targets, axes = (
                np.asarray(file[name], dtype=np.float64)
                for name in ("rest", "displacement", "targets", "axes")
            )
    except FileNotFoundError:
        raise CalibrationError(f"{path}: no such file; make a pose model with palpate-edge train") from None
    except DAMAGED as error:
        raise CalibrationError(f"{path} is damaged ({error}): {AGAIN}") from None
    count = len(targets)
    shapes_fit = (
        rest.ndim == 2
        and rest.shape[1:] == (2,)
        and displacement.shape == (count, rest.size)
        and targets.shape == (count, len(labels))
        and axes.shape in ((0,), (2,))
        and set(labels) <= set(POSE_LABELS)
    )
    if not shapes_fit or not count or not all(np.isfinite(a).all() for a in (rest, displacement, targets)):
        raise CalibrationError(f"{path} contains no presses, or values that do not belong together: {AGAIN}")
    declared = LabelAxes(float(axes[0]), "sensor" if axes[1] else "object") if len(axes) else None
    return PoseModel(rest, displacement, labels, targets, declared)
