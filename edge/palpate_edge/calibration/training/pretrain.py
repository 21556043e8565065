"""Press datasets of other sensors -> a dome model that a new sensor of the same make can start from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate_edge.calibration.measurement import measure
from palpate_edge.calibration.training.dome_model import DomeModel, TwistedPresses
from palpate_edge.calibration.training.samples import Samples, make_samples, training_presses
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.displacement_field import DisplacementReader

MOST_SAMPLES = 2000


def pretrain(
    folders: Sequence[Path], progress: Callable[[int, int], None] = lambda _done, _total: None
) -> DomeModel:
    """The train presses of all datasets, brought to the first one's size and stiffness; their torsions if
    all datasets have them.

    Raises DatasetError for a dataset without presses, and what measuring it raises.
    """
    datasets = [read_dataset(folder) for folder in folders]
    total = sum(len(dataset.reference) + len(dataset.split("train")) for dataset in datasets)
    radius_mm = datasets[0].sensor.markers.radius_mm
    parts: list[Samples] = []
    larger: list[float] = []  # the first sensor over each
    before = 0

    def report(done: int) -> None:
        progress(before + done, total)

    for dataset in datasets:
        presses = dataset.split("train")
        measured = measure(dataset, presses, report)
        before += len(dataset.reference) + len(presses)
        found = training_presses(measured)
        if not found:
            raise DatasetError(f"{dataset.folder} has no train press that moves the skin: leave it out")
        if found[0].force_N is None:
            raise DatasetError(
                f"{dataset.folder / 'truth.csv'} has no force, and a dome model needs that of every press: "
                "leave this dataset out"
            )
        own_radius_mm = dataset.sensor.markers.radius_mm
        reader = DisplacementReader(measured.reference.position_px, measured.view, own_radius_mm)
        copies = max(1, MOST_SAMPLES // (2 * len(found) * len(datasets)))
        samples = make_samples(reader, found, copies=copies)
        larger.append(radius_mm / own_radius_mm)
        parts.append(replace(samples, fields=samples.fields * larger[-1]))
    softer = [_stiffness(parts[0]) / _stiffness(part) for part in parts]
    torsions = [
        part.torsions_Nmm * share * ratio
        for part, share, ratio in zip(parts, softer, larger, strict=True)
        if part.torsions_Nmm is not None
    ]
    fields = np.concatenate([part.fields for part in parts])
    return DomeModel(
        fields,
        np.concatenate([part.directions for part in parts]),
        np.concatenate([part.forces_N * share for part, share in zip(parts, softer, strict=True)]),
        radius_mm,
        TwistedPresses(fields, np.concatenate(torsions)) if len(torsions) == len(parts) else None,
    )


def _stiffness(samples: Samples) -> float:
    """Median force over motion, N/mm."""
    return float(np.median(np.linalg.norm(samples.forces_N, axis=1) / np.linalg.norm(samples.fields, axis=1)))
