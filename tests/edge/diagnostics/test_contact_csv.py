"""The columns of the CSV are a contract with whoever reads it."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.errors import DatasetError
from palpate_edge.diagnostics.contact_csv import write_contacts

HEADER = "frame,contact,x_mm,y_mm,z_mm,fn_N,fx_N,fy_N,fz_N,quality,ms,reason,radius95_mm,torsion_Nmm"
TOUCH = Contact(
    3, 99, True, True, (1.5, -2.25, 29.9), 1.25, (0.1, 0.2, -1.2), 1.0, "", 85, 85, radius95_mm=0.4
)
TURNED = replace(TOUCH, torsion_Nmm=-3.25)
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
        "a.jpg,1,1.5000,-2.2500,29.9000,1.25000,0.10000,0.20000,-1.20000,1.000,1.500,,0.400,\n"
        "b.jpg,0,,,,0.00000,0.00000,0.00000,0.00000,0.970,1.000,,,\n"
        "turned.jpg,1,1.5000,-2.2500,29.9000,1.25000,0.10000,0.20000,-1.20000,1.000,1.500,,0.400,-3.2500\n"
        "c.jpg,1,0.0000,0.0000,30.0000,,,,,1.000,2.000,,,\n"
        'd.jpg,0,,,,,,,,0.000,0.250,"only 3 of 85 beads found, of which 1 moved",,\n'
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
