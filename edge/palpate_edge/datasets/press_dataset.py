"""Press dataset: images of a dome pressed by a probe at known places and forces (docs/press-dataset.md)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from palpate_edge.common.contact import Vector3
from palpate_edge.common.contact_quantities import POSE_LABELS
from palpate_edge.common.errors import DatasetError
from palpate_edge.common.type_text import value_text
from palpate_edge.datasets.images import list_images
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_edge.datasets.truth_table import (
    check_frame_and_split,
    check_length,
    finite_number,
    read_rows,
)
from palpate_edge.datasets.weights_table import NEWTONS_PER_GRAM, WEIGHTS, WeightRow, read_weight_rows
from palpate_edge.geometry.sensor import Sensor

COLUMNS = ["frame", "split", "t_s", "x_mm", "y_mm", "z_mm", "fn_N", "fx_N", "fy_N", "fz_N", "probe", "lost"]
LARGEST = {"t_s": 1e9, "lost": 1e6} | dict.fromkeys(("x_mm", "y_mm", "z_mm"), 1e3)  # others: 1e4
SMALLEST_RADIUS_MM = 0.1  # of a contact: nearer to the dome's centre there is no direction
FORCES = ("fn_N", "fx_N", "fy_N", "fz_N")
TORSION = "torsion_Nmm"
"""Optional column after those."""

BOUNDS = ["fn_low_N", "fn_high_N"]
"""Optional last columns: limits of the normal force by the friction cone, where only a part of the force was
measured (docs/press-rig.md). They are checked and not used."""


@dataclass(frozen=True, slots=True)
class Press:
    """One row of truth.csv.

    frame: file name under frames/. position_mm: point of first touch on the undeformed outer surface, None
    without contact and for a press on a scale. normal_force_N: >= 0; force_N: total force on the dome; both
    None for a contact whose force was not measured. lost: number of hidden beads. torsion_Nmm: moment of the
    contact about the inward normal through that point, None for a contact whose torsion was not measured.

    Of the force of a weighed press only the normal component is known. It is near the apex, on a scale or
    below a weight, without a place; or through a hole of a jig, which gives the place (docs/jig.md).
    """

    frame: str
    split: str
    time_s: float
    position_mm: Vector3 | None
    normal_force_N: float | None
    force_N: Vector3 | None
    probe: str
    lost: int
    torsion_Nmm: float | None = None

    @property
    def is_weighed(self) -> bool:
        """Return whether of this press's force only the normal component is known."""
        return self.force_N is None and bool(self.normal_force_N)

    @property
    def touches(self) -> bool:
        """Return whether something touches the dome."""
        return self.position_mm is not None or self.is_weighed


@dataclass(frozen=True, slots=True)
class PressDataset:
    """One sensor's recording; `presses` is empty without a truth.csv and a weights.csv."""

    folder: Path
    sensor: Sensor
    reference: tuple[Path, ...]
    presses: tuple[Press, ...]

    def split(self, name: str) -> tuple[Press, ...]:
        """Return the presses of one split, ``train`` or ``test``."""
        return tuple(press for press in self.presses if press.split == name)

    def path(self, press: Press) -> Path:
        return self.folder / "frames" / press.frame


def is_dataset(folder: Path) -> bool:
    return (folder / "sensor.toml").is_file()


def read_dataset(folder: Path) -> PressDataset:
    """Read a press dataset's description and truth; images are read when needed.

    Raises DatasetError with file, line and column.
    """
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder: give a press dataset's folder")
    sensor = read_sensor(folder / "sensor.toml")
    reference = tuple(list_images(folder / "reference"))
    truth, weights = folder / "truth.csv", folder / WEIGHTS
    presses = read_truth(truth) if truth.exists() else ()
    if weights.exists():
        presses += read_weights(weights, sensor.dome.outer_radius_mm)
    return PressDataset(folder, sensor, reference, presses)


def read_weights(path: Path, outer_radius_mm: float) -> tuple[Press, ...]:
    """Read the presses of a weights.csv: those at the apex, and those of a jig's rod, along the normal.

    Raises DatasetError with the line and the column.
    """
    return tuple(_weighed(row, outer_radius_mm) for row in read_weight_rows(path))


def _weighed(row: WeightRow, outer_radius_mm: float) -> Press:
    force_N = row.mass_g * NEWTONS_PER_GRAM
    if not row.mass_g:
        return Press(row.frame, row.split, 0.0, None, 0.0, (0.0, 0.0, 0.0), "none", 0, 0.0)
    if row.theta_deg is None or row.phi_deg is None:
        return Press(row.frame, row.split, 0.0, None, force_N, None, "weight", 0)
    theta, phi = math.radians(row.theta_deg), math.radians(row.phi_deg)
    x, y, z = math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)
    place = (outer_radius_mm * x, outer_radius_mm * y, outer_radius_mm * z)
    return Press(row.frame, row.split, 0.0, place, force_N, None, "rod", 0)


def read_truth(path: Path) -> tuple[Press, ...]:
    """Read all rows of a truth.csv. Raises DatasetError with the line and the column.

    Forces are unknown where no contact has any: its four columns are blank, or 0 in every row. The same holds
    for the torsion, whose column is optional. Columns of pose labels (docs/own-sensor.md) are left out.
    """
    rows = read_rows(path, "docs/press-dataset.md")
    columns = rows[0] if rows else []
    own = [column for column in columns if column not in POSE_LABELS]
    if own not in [[*COLUMNS, *more] for more in ([], [TORSION], BOUNDS, [TORSION, *BOUNDS])]:
        raise DatasetError(
            f"{path}: the first line must be {','.join(COLUMNS)}, or that and {TORSION} as the last column; "
            f"further columns may be {', '.join((*POSE_LABELS, *BOUNDS))}"
        )
    presses = {
        number: _press(path, number, row, columns) for number, row in enumerate(rows[1:], start=2) if row
    }
    touches = {number: press for number, press in presses.items() if press.position_mm is not None}
    _check_all_or_none(path, {n: press.force_N for n, press in touches.items()}, FORCES, "force")
    _check_all_or_none(path, {n: press.torsion_Nmm for n, press in touches.items()}, (TORSION,), "torsion")
    if not any(_has_force(press) for press in touches.values()):
        for number, press in touches.items():
            presses[number] = replace(press, normal_force_N=None, force_N=None)
    if not any(press.torsion_Nmm for press in touches.values()):
        for number in touches:
            presses[number] = replace(presses[number], torsion_Nmm=None)
    return tuple(presses.values())


def _check_all_or_none(
    path: Path, values: Mapping[int, object], columns: Sequence[str], quantity: str
) -> None:
    """Refuse contacts, by line, of which some have the quantity (not None) and some do not."""
    blank = [number for number, value in values.items() if value is None]
    are = "is" if len(columns) == 1 else "are"
    if blank and len(blank) < len(values):
        raise DatasetError(
            f"{path}, line {blank[0]}: {', '.join(columns)} {are} blank, but "
            f"{len(values) - len(blank)} other contacts have a {quantity}: give the {quantity} of every "
            "contact, or of none"
        )


def _has_force(press: Press) -> bool:
    return press.force_N is not None and any((press.normal_force_N, *press.force_N))


def _press(path: Path, number: int, row: list[str], columns: list[str]) -> Press:
    where = f"{path}, line {number}"
    check_length(where, row, columns)
    cell = dict(zip(columns, row, strict=True))

    def value(column: str) -> float:
        number_read = finite_number(where, column, cell[column])
        largest = LARGEST.get(column, 1e4)
        if abs(number_read) > largest:
            raise DatasetError(
                f"{where}: {column} = {value_text(cell[column])} is out of range: it must be "
                f"{-largest:g} to {largest:g}"
            )
        return number_read

    check_frame_and_split(where, cell["frame"], cell["split"])
    touches = any(cell[column] for column in ("x_mm", "y_mm", "z_mm"))
    normal_force_N: float | None = None if touches else 0.0
    force_N: Vector3 | None = None if touches else (0.0, 0.0, 0.0)
    if not touches and cell["fn_N"] and not any(cell[column] for column in FORCES[1:]):
        normal_force_N, force_N = value("fn_N"), None
    elif any(cell[column] for column in FORCES):
        normal_force_N, force_N = value("fn_N"), (value("fx_N"), value("fy_N"), value("fz_N"))
    torsion_Nmm: float | None = None if touches else 0.0
    if cell.get(TORSION):
        torsion_Nmm = value(TORSION)
    for column in BOUNDS:
        if cell.get(column):
            value(column)
    place = (value("x_mm"), value("y_mm"), value("z_mm")) if touches else None
    if place is not None and math.hypot(*place) < SMALLEST_RADIUS_MM:
        raise DatasetError(
            f"{where}: x_mm, y_mm, z_mm = {cell['x_mm']}, {cell['y_mm']}, {cell['z_mm']} is "
            "the dome's centre: give the point of its outer surface, or leave them blank without a contact"
        )
    return Press(
        frame=cell["frame"],
        split=cell["split"],
        time_s=value("t_s"),
        position_mm=place,
        normal_force_N=normal_force_N,
        force_N=force_N,
        probe=cell["probe"],
        lost=int(value("lost")),
        torsion_Nmm=torsion_Nmm,
    )
