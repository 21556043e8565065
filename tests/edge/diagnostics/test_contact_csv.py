"""The columns of the CSV are a contract with whoever reads it."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from palpate_edge.common.contact import Contact, LabelEstimate, refused_contact
from palpate_edge.common.errors import DatasetError
from palpate_edge.diagnostics.contact_csv import write_contacts

HEADER = (
    "frame,contact,x_mm,y_mm,z_mm,fn_N,fx_N,fy_N,fz_N,quality,ms,reason,radius95_mm,torsion_Nmm,"
    "depth_mm,tilt_x_deg,tilt_y_deg,shear_x_mm,shear_y_mm,torsion_deg,"
    "depth_mm_95,tilt_x_deg_95,tilt_y_deg_95,shear_x_mm_95,shear_y_mm_95,torsion_deg_95,"
    "torsion95_Nmm,force95_N"
)
NO_POSE = 14 * ","
TOUCH = Contact(
    3, 99, True, True, (1.5, -2.25, 29.9), 1.25, (0.1, 0.2, -1.2), 1.0, "", 85, 85, radius95_mm=0.4
)
TURNED = replace(TOUCH, torsion_Nmm=-3.25, torsion95_Nmm=0.5, force95_N=0.0625)
POSED = replace(TOUCH, pose=(LabelEstimate("depth_mm", 1.25, 0.5), LabelEstimate("torsion_deg", -2.0, 3.0)))
NOTHING = Contact(4, 99, True, False, None, 0.0, (0.0, 0.0, 0.0), 0.97, "", 83, 85)
UNKNOWN = Contact(4, 99, True, True, (0.0, 0.0, 30.0), None, None, 1.0, "", 85, 85)


def test_the_file_is_this(tmp_path):
    rows = [
        ("a.jpg", TOUCH, 1.5),
        ("b.jpg", NOTHING, 1.0),
        ("turned.jpg", TURNED, 1.5),
        ("c.jpg", UNKNOWN, 2.0),
        ("d.jpg", refused_contact(5, 99, "only 3 of 85 beads found, of which 1 moved", 3, 85), 0.25),
    ]
    write_contacts(tmp_path / "out.csv", rows)
    assert (tmp_path / "out.csv").read_text() == (
        f"{HEADER}\n"
        f"a.jpg,1,1.5000,-2.2500,29.9000,1.25000,0.10000,0.20000,-1.20000,1.000,1.500,,0.400,{NO_POSE}\n"
        f"b.jpg,0,,,,0.00000,0.00000,0.00000,0.00000,0.970,1.000,,,{NO_POSE}\n"
        f"turned.jpg,1,1.5000,-2.2500,29.9000,1.25000,0.10000,0.20000,-1.20000,1.000,1.500,,0.400,-3.2500{NO_POSE[:-2]},0.5000,0.06250\n"
        f"c.jpg,1,0.0000,0.0000,30.0000,,,,,1.000,2.000,,,{NO_POSE}\n"
        f'd.jpg,0,,,,,,,,0.000,0.250,"only 3 of 85 beads found, of which 1 moved",,{NO_POSE}\n'
    )
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]


def test_names_with_commas_survive(tmp_path):
    write_contacts(tmp_path / "out.csv", [('odd,"name".jpg', TOUCH, 1.0)])
    with (tmp_path / "out.csv").open(newline="") as file:
        assert next(iter(csv.DictReader(file)))["frame"] == 'odd,"name".jpg'


@pytest.mark.parametrize("former", [None, "what was there before\n"])
def test_a_refusal_half_way_leaves_what_was_there(tmp_path, former):
    path = tmp_path / "out.csv"
    if former:
        path.write_text(former)

    def rows():
        yield "a.jpg", TOUCH, 1.0
        raise DatasetError("b.jpg is cut short: copy it again")

    with pytest.raises(DatasetError, match="cut short"):
        write_contacts(path, rows())
    assert [found.read_text() for found in tmp_path.iterdir()] == ([former] if former else [])


@pytest.mark.parametrize("name", ["nowhere/out.csv", "."])
def test_a_place_that_cannot_be_written_is_refused(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DatasetError, match="cannot be written"):
        write_contacts(Path(name), [("a.jpg", TOUCH, 1.0)])
    assert list(tmp_path.iterdir()) == []


def test_a_pose_fills_the_columns_of_its_labels(tmp_path):
    write_contacts(tmp_path / "out.csv", [("a.jpg", POSED, 1.5)])
    line = (tmp_path / "out.csv").read_text().splitlines()[1]
    assert line.endswith(",0.400,,1.2500,,,,,-2.0000,0.5000,,,,,3.0000,,")
