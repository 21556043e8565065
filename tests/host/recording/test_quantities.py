"""Torsion and radius from the host's status to CSV, Parquet, MCAP and plots; unknown stays unknown."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from palpate_edge.common.contact_quantities import FLAT_POSE_FIELDS
from palpate_host.common.status import HoldStatus, HostStatus
from palpate_host.recording.mcap import McapRecording
from palpate_host.recording.parquet import write_parquet
from palpate_host.recording.statuses import read_statuses
from palpate_host.recording.table import write_csv
from palpate_host.service.host import load_hand
from palpate_host.view.blueprint import PLOTS
from palpate_host.view.hand_view import plotted

PROJECT = Path(__file__).resolve().parents[3]
LOG = PROJECT / "tests" / "replay" / "normal.log.gz"
HAND = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
RADIUS, TORSION = "observation.radius95_mm.finger-1", "observation.torsion_Nmm.finger-1"


@pytest.fixture(scope="module")
def touching() -> HostStatus:
    """Return a tick of a grasp: radius 0.35 mm from the bus, torsion put in by hand for finger-1."""
    status = list(read_statuses(LOG, *load_hand(HAND)))[-1]
    first, *others = status.fingers
    assert first.in_contact
    assert (first.radius95_mm, first.torsion_Nmm) == (0.35, None)
    return replace(status, fingers=(replace(first, torsion_Nmm=-2.5), *others))


@pytest.fixture(scope="module")
def unknown(touching: HostStatus) -> HostStatus:
    """Return the next tick: finger-1 has lost its contact."""
    first, *others = touching.fingers
    gone = replace(
        first, in_contact=False, position_mm=None, normal_force_N=None, shear_N=None, radius95_mm=None,
        torsion_Nmm=None, sequence=(first.sequence or 0) + 1,
    )  # fmt: skip
    return replace(touching, time_us=touching.time_us + 10_000, fingers=(gone, *others))


def test_csv_has_them_behind_the_columns_there_were(
    tmp_path: Path, touching: HostStatus, unknown: HostStatus
) -> None:
    write_csv(tmp_path / "hand.csv", [touching, unknown])
    with (tmp_path / "hand.csv").open(newline="") as file:
        first, second = csv.DictReader(file)
    names = list(first)
    assert names[names.index("mode") + 1 : names.index("orientation_error_deg")] == [
        f"observation.{column}.finger-{number}"
        for column in ("radius95_mm", "torsion_Nmm", "torsion95_Nmm", "force95_N", *FLAT_POSE_FIELDS)
        for number in (1, 2, 3)
    ]
    assert names[names.index("orientation_error_deg") + 1 :] == [
        *(
            f"observation.{column}.finger-{number}"
            for column in ("friction_ratio", "friction", "friction_margin")
            for number in (1, 2, 3)
        ),
        "grip_N",
        *("object_x_mm", "object_y_mm", "object_z_mm", "object_place95_mm", "object_orientation95_deg"),
        *("load_x_N", "load_y_N", "load_z_N"),
    ]
    tactile = [name for name in names if name.startswith("observation.tactile.finger-1.")]
    assert [name.rpartition(".")[2] for name in tactile] == [
        "x_mm", "y_mm", "z_mm", "fn_N", "fx_N", "fy_N", "in_contact", "slip"
    ]  # fmt: skip
    assert (first[RADIUS], first[TORSION]) == ("0.35", "-2.5")
    assert (second[RADIUS], second[TORSION]) == ("", "")


def test_the_hold_is_columns_and_they_are_empty_in_older_recordings(
    tmp_path: Path, touching: HostStatus
) -> None:
    hold = HoldStatus(
        *((0.25, None, 0.1), (0.4, 0.4, 0.27), (0.15, None, 0.17), (0, 0, 1), 2.97, False),
        *((1.5, 0.0, 93.2), 0.21, 0.4, (0.0, 0.0, 1.1), True),
    )
    held = replace(touching, hold=hold)
    assert touching.hold is None
    write_csv(tmp_path / "hand.csv", [touching, held])
    with (tmp_path / "hand.csv").open(newline="") as file:
        older, row = csv.DictReader(file)
    columns = [name for name in row if "friction" in name or name.startswith(("grip", "object", "load"))]
    assert {older[name] for name in columns} == {""}
    found = [row[name] for name in columns]
    assert found[:10] == ["0.25", "", "0.1", "0.4", "0.4", "0.27", "0.15", "", "0.17", "2.97"]
    assert found[10:] == ["1.5", "0.0", "93.2", "0.21", "0.4", "0.0", "0.0", "1.1"]
    write_parquet(tmp_path / "hand.parquet", [held])
    table = pq.read_table(tmp_path / "hand.parquet")
    assert table["observation.friction"][0].as_py() == pytest.approx([0.4, 0.4, 0.27])
    assert table["grip_N"][0].as_py() == pytest.approx(2.97)


def test_parquet_has_one_vector_a_quantity(tmp_path: Path, touching: HostStatus, unknown: HostStatus) -> None:
    write_parquet(tmp_path / "hand.parquet", [touching, unknown])
    table = pq.read_table(tmp_path / "hand.parquet")
    names = json.loads(table.schema.metadata[b"names"])
    assert (
        names["observation.radius95_mm"]
        == names["observation.torsion_Nmm"]
        == ["finger-1", "finger-2", "finger-3"]
    )
    assert names["observation.tactile.finger-1"] == ["x_mm", "y_mm", "z_mm", "fn_N", "fx_N", "fy_N"]
    radius, torsion = (
        table.column(f"observation.{name}").to_pylist() for name in ("radius95_mm", "torsion_Nmm")
    )
    assert radius[0] == pytest.approx([0.35] * 3)
    assert torsion[0][0] == pytest.approx(-2.5)
    assert math.isnan(torsion[0][1]) and math.isnan(radius[1][0]) and math.isnan(torsion[1][0])


def test_mcap_has_every_quantity_of_a_contact(
    tmp_path: Path, touching: HostStatus, unknown: HostStatus
) -> None:
    config, hand = load_hand(HAND)
    path = tmp_path / "hand.mcap"
    with McapRecording(path, hand, [finger.name for finger in config.fingers]) as recording:
        for status in (touching, touching, unknown):
            recording.write(status)
    with path.open("rb") as file:
        topic = "/tactile/finger-1/quantities"
        messages = [
            (schema, json.loads(message.data))
            for schema, _, message in make_reader(file).iter_messages([topic])
        ]
    (schema, first), (_, second) = messages  # a contact is written once
    assert first == {
        "x_mm": 0.0, "y_mm": -4.0, "z_mm": 29.7, "fn_N": 1.0, "fx_N": 0.0, "fy_N": 0.0,
        "radius95_mm": 0.35, "torsion_Nmm": -2.5, "torsion95_Nmm": None, "force95_N": None,
        **dict.fromkeys(FLAT_POSE_FIELDS),
    }  # fmt: skip
    assert set(second.values()) == {None}
    described = json.loads(schema.data)["properties"]
    assert described["torsion_Nmm"] == {"type": ["number", "null"], "description": "torsion, N mm"}
    assert set(described) == set(first)


def test_the_viewer_plots_them(touching: HostStatus, unknown: HostStatus) -> None:
    plots = dict(plotted(touching.fingers[0]))
    assert (plots["radius95/finger-1"], plots["torsion/finger-1"]) == (0.35, -2.5)
    assert dict(plotted(unknown.fingers[0])) == {"force/finger-1": 0.0}
    assert ["radius95/**"] in PLOTS.values()
    assert ["torsion/**"] in PLOTS.values()
