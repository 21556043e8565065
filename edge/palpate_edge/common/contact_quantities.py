"""Table of the contact quantities: one row holds the name of a quantity in every place where it appears.

The codecs of node and host, the host's status, the columns and topics of recordings, the viewer's plots, the
monitor and the bus-load budget are made from this table; ``fingertip.eds`` and docs/bus.md are checked
against it. docs/bus.md describes how to add a quantity.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import msgspec

AI_AUTOZERO, AI_UNIT, AI_DECIMALS, AI_STATUS, AI_INPUT = 0x6125, 0x6131, 0x6132, 0x6150, 0x7130
"""CiA 404, analog input block: each quantity is one channel, that is one sub-index; 7130h is an INTEGER16."""

UNIT_CODES = {"mm": 0xFD01_0000, "N": 0x0021_0000, "N mm": 0xFD23_0000, "deg": 0x0041_0000}
"""Values of 6131h by CiA 303-2: prefix, numerator, denominator, reserved."""

NOT_GIVEN = -0x8000
"""Value of 7130h of a quantity that the estimation method does not give; no measured value."""

BASE_TPDOS = (1, 2, 3)
"""TPDOs of a contact that every fingertip sends, in the order of the bus; the last one closes the set."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OptionalQuantities:
    """Fields shared by Contact, TipContact and FingerStatus; None when the estimation method gives none.

    radius95_mm: with 95 % probability the true contact is no farther from position_mm than this.
    torsion_Nmm: about the inward normal.
    torsion95_Nmm: half width of the torsion's 95 % interval.
    force95_N: with 95 % probability the true force is no farther from force_N than this.
    """

    radius95_mm: float | None = None
    torsion_Nmm: float | None = None
    torsion95_Nmm: float | None = None
    force95_N: float | None = None


class FlatPose(msgspec.Struct, frozen=True, kw_only=True):
    """Pose of a flat object on a sensor (docs/own-sensor.md); None for a label that was not learned.

    Those ending in _95: half widths of 95 % intervals.
    """

    depth_mm: float | None = None
    tilt_x_deg: float | None = None
    tilt_y_deg: float | None = None
    shear_x_mm: float | None = None
    shear_y_mm: float | None = None
    torsion_deg: float | None = None
    depth_mm_95: float | None = None
    tilt_x_deg_95: float | None = None
    tilt_y_deg_95: float | None = None
    shear_x_mm_95: float | None = None
    shear_y_mm_95: float | None = None
    torsion_deg_95: float | None = None


FLAT_POSE_FIELDS = FlatPose.__struct_fields__
POSE_LABELS = tuple(name for name in FLAT_POSE_FIELDS if not name.endswith("_95"))
"""Columns of truth.csv and of the CSV of estimates, in their order there."""


class SensorOutputs(msgspec.Struct, frozen=True):
    """Parts of a contact that a calibration gives.

    place: position on the dome; force: normal force and shear; pose: of a flat object. A contact without one
    that its sensor gives is in doubt; one that its sensor does not give is unknown, and the rest is valid.
    """

    place: bool = True
    force: bool = True
    pose: bool = False


class Quantity(msgspec.Struct, frozen=True, kw_only=True):
    """One quantity of a contact.

    name: as the EDS spells it, behind "Value of", "Unit of", "Status of".
    attribute, element: field of Contact, TipContact and FingerStatus; element of a vector or field of a pose.
    column: short name with its unit, for CSV, Parquet and MCAP.
    channel: sub-index of 6125h, 6131h, 6132h, 6150h and 7130h.
    unit, decimals: 6131h and 6132h; the raw value counts 10^-decimals units.
    tpdo: number of the TPDO and place in its mapping, both from 1.
    usual_raw: range of raw values on an ordinary hand, for the bus-load budget.
    optional: a method may omit the quantity without making the contact doubtful.
    not_given: raw value where a contact lacks the quantity; None: the channel then carries 0, but NOT_GIVEN
        where the sensor gives none.
    csv_digits: digits in the CSV of ``palpate-edge estimate``; None: no column there.
    in_tactile_vector: element of ``observation.tactile.FINGER`` in a recording's table; the other quantities
        have a column of their own, ``observation.COLUMN``, with one element a finger.
    plot: entity of the viewer, or empty. panel: title of the plot panel shown at first, or empty.
    """

    name: str
    attribute: str
    element: int | str | None = None
    column: str
    channel: int
    unit: str
    decimals: int
    tpdo: tuple[int, int]
    usual_raw: tuple[int, int]
    optional: bool = False
    not_given: int | None = None
    csv_digits: int | None = None
    in_tactile_vector: bool = False
    plot: str = ""
    panel: str = ""

    @property
    def increments_per_unit(self) -> int:
        """Raw increments in one unit."""
        return int(10**self.decimals)

    def value(self, raw: int) -> float | None:
        """Convert a raw value of 7130h to the quantity's unit; None for NOT_GIVEN."""
        return None if raw == NOT_GIVEN else raw / self.increments_per_unit

    def of(self, contact: object) -> float | None:
        """Return the quantity of a Contact, TipContact or FingerStatus."""
        return _element(getattr(contact, self.attribute), self.element)

    def recording_column(self, finger: str) -> str:
        """Return the column of the table of a recording (CSV and Parquet)."""
        if self.in_tactile_vector:
            return f"observation.tactile.{finger}.{self.column}"
        return f"observation.{self.column}.{finger}"


def _of_pose(
    name: str, label: str, channel: int, tpdo: tuple[int, int], usual_raw: tuple[int, int]
) -> Quantity:
    """Return the row of a pose label, or of its half width."""
    unit, decimals = ("deg", 2) if "_deg" in label else ("mm", 3)
    return Quantity(
        name=name,
        attribute="flat_pose",
        element=label,
        column=label,
        channel=channel,
        unit=unit,
        decimals=decimals,
        tpdo=tpdo,
        usual_raw=usual_raw,
        optional=True,
        not_given=NOT_GIVEN,
        csv_digits=4,
        plot=f"pose/{{finger}}/{label}",
    )


QUANTITIES = (
    Quantity(
        name="contact x",
        attribute="position_mm",
        element=0,
        column="x_mm",
        channel=1,
        unit="mm",
        decimals=2,
        tpdo=(1, 1),
        usual_raw=(-2000, 2000),
        csv_digits=4,
        in_tactile_vector=True,
    ),
    Quantity(
        name="contact y",
        attribute="position_mm",
        element=1,
        column="y_mm",
        channel=2,
        unit="mm",
        decimals=2,
        tpdo=(1, 2),
        usual_raw=(-2000, 2000),
        csv_digits=4,
        in_tactile_vector=True,
    ),
    Quantity(
        name="contact z",
        attribute="position_mm",
        element=2,
        column="z_mm",
        channel=3,
        unit="mm",
        decimals=2,
        tpdo=(1, 3),
        usual_raw=(1500, 3000),
        csv_digits=4,
        in_tactile_vector=True,
    ),
    Quantity(
        name="normal force",
        attribute="normal_force_N",
        column="fn_N",
        channel=4,
        unit="N",
        decimals=3,
        tpdo=(1, 4),
        usual_raw=(0, 3000),
        csv_digits=5,
        in_tactile_vector=True,
        plot="force/{finger}",
        panel="Force on each tip, N",
    ),
    Quantity(
        name="shear force x",
        attribute="shear_N",
        element=0,
        column="fx_N",
        channel=5,
        unit="N",
        decimals=3,
        tpdo=(2, 1),
        usual_raw=(-500, 500),
        optional=True,
        in_tactile_vector=True,
        plot="shear/{finger}/x",
    ),
    Quantity(
        name="shear force y",
        attribute="shear_N",
        element=1,
        column="fy_N",
        channel=6,
        unit="N",
        decimals=3,
        tpdo=(2, 2),
        usual_raw=(-500, 500),
        optional=True,
        in_tactile_vector=True,
        plot="shear/{finger}/y",
    ),
    Quantity(
        name="error radius",
        attribute="radius95_mm",
        column="radius95_mm",
        channel=8,
        unit="mm",
        decimals=2,
        tpdo=(5, 2),
        usual_raw=(0, 500),
        optional=True,
        not_given=NOT_GIVEN,
        csv_digits=3,
        plot="radius95/{finger}",
        panel="95 % radius of each contact, mm",
    ),
    Quantity(
        name="torsion",
        attribute="torsion_Nmm",
        column="torsion_Nmm",
        channel=7,
        unit="N mm",
        decimals=2,
        tpdo=(2, 3),
        usual_raw=(-500, 500),
        optional=True,
        not_given=NOT_GIVEN,
        csv_digits=4,
        plot="torsion/{finger}",
        panel="Torsion on each tip, N mm",
    ),
    Quantity(
        name="torsion error",
        attribute="torsion95_Nmm",
        column="torsion95_Nmm",
        channel=9,
        unit="N mm",
        decimals=2,
        tpdo=(5, 3),
        usual_raw=(0, 300),
        optional=True,
        not_given=NOT_GIVEN,
        csv_digits=4,
        plot="torsion95/{finger}",
    ),
    Quantity(
        name="force error",
        attribute="force95_N",
        column="force95_N",
        channel=10,
        unit="N",
        decimals=3,
        tpdo=(5, 4),
        usual_raw=(0, 300),
        optional=True,
        not_given=NOT_GIVEN,
        csv_digits=5,
        plot="force95/{finger}",
    ),
    _of_pose("object depth", "depth_mm", 11, (6, 2), (0, 5000)),
    _of_pose("object tilt x", "tilt_x_deg", 12, (6, 3), (-2500, 2500)),
    _of_pose("object tilt y", "tilt_y_deg", 13, (6, 4), (-2500, 2500)),
    _of_pose("object shear x", "shear_x_mm", 14, (7, 2), (-5000, 5000)),
    _of_pose("object shear y", "shear_y_mm", 15, (7, 3), (-5000, 5000)),
    _of_pose("object torsion", "torsion_deg", 16, (7, 4), (-2500, 2500)),
    _of_pose("object depth error", "depth_mm_95", 17, (8, 2), (0, 500)),
    _of_pose("object tilt x error", "tilt_x_deg_95", 18, (8, 3), (0, 300)),
    _of_pose("object tilt y error", "tilt_y_deg_95", 19, (8, 4), (0, 300)),
    _of_pose("object shear x error", "shear_x_mm_95", 20, (9, 2), (0, 2000)),
    _of_pose("object shear y error", "shear_y_mm_95", 21, (9, 3), (0, 2000)),
    _of_pose("object torsion error", "torsion_deg_95", 22, (9, 4), (0, 500)),
)
"""Rows in the order of their columns in CSV files, which is a contract: a new row goes last."""

EXTRA_TPDOS = tuple(sorted({quantity.tpdo[0] for quantity in QUANTITIES} - {*BASE_TPDOS}))
"""TPDOs of further quantities, sent before the last of BASE_TPDOS; each repeats the sequence (2013h)."""

CONTACT_TPDOS = tuple(sorted([*BASE_TPDOS, *EXTRA_TPDOS]))

POSE_TPDOS = tuple(sorted({row.tpdo[0] for row in QUANTITIES if row.attribute == "flat_pose"}))
"""Extra TPDOs that are disabled in the EDS; a node whose sensor gives poses enables them."""

FD_TPDO = 10
"""TPDO that carries all of them in one CAN FD frame, without poses or with."""

FD_TPDO_POSES = len(QUANTITIES) + 5
"""Number of objects that it maps with poses; the EDS lists them last. 2010h to 2014h are no quantities."""

POSE_NODE_OFFSET = 0x20
"""POSE_TPDOS have the identifiers of TPDO 1, RPDO 1, TPDO 2, RPDO 2 of a node with an id that much higher."""

ATTRIBUTES = tuple(dict.fromkeys(quantity.attribute for quantity in QUANTITIES))
"""The fields of TipContact and FingerStatus that hold quantities."""

_GROUPS = tuple((name, tuple(group)) for name, group in groupby(QUANTITIES, key=lambda row: row.attribute))


def values_of(contact: object) -> tuple[float | None, ...]:
    """Return the quantities of a Contact, TipContact or FingerStatus in the order of QUANTITIES."""
    values: list[float | None] = []
    for attribute, group in _GROUPS:
        whole = getattr(contact, attribute)  # once for a vector: the shear of a Contact is computed
        values += [_element(whole, quantity.element) for quantity in group]
    return tuple(values)


def fields_of(raw_by_channel: Mapping[int, int]) -> dict[str, Any]:
    """Return the fields of TipContact from raw values of 7130h; a channel that is missing is not given.

    A vector is None when one of its elements is, a pose when all of its labels are.
    """
    found: dict[str, Any] = {}
    for attribute, group in _GROUPS:
        raws = [(quantity, raw_by_channel.get(quantity.channel)) for quantity in group]
        values = [None if raw is None else quantity.value(raw) for quantity, raw in raws]
        if group[0].element is None:
            found[attribute] = values[0]
        elif isinstance(group[0].element, int):
            found[attribute] = None if None in values else tuple(values)
        elif any(value is not None for value in values):
            found[attribute] = FlatPose(**dict(zip(FLAT_POSE_FIELDS, values, strict=True)))
        else:
            found[attribute] = None
    return found


def _element(whole: Any, element: int | str | None) -> float | None:
    if whole is None or element is None:
        value: float | None = whole
    elif isinstance(element, str):
        value = getattr(whole, element)
    else:
        value = whole[element]
    return value


def columns_of(quantities: Iterable[Quantity]) -> tuple[str, ...]:
    """Return the short names of `quantities`."""
    return tuple(quantity.column for quantity in quantities)
