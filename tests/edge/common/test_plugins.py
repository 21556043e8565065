"""Parts by name: palpate's own, and those that another package registers by entry point."""

from __future__ import annotations

import pytest

from palpate_edge.common.errors import ConfigError
from palpate_edge.common.plugins import load_part, part_names

GROUP = "palpate_test.shapes"
OWN = {"own": "fractions:Fraction", "gone": "no_such_module:Shape", "empty": "fractions:Shape"}


@pytest.fixture
def another_package(tmp_path, monkeypatch):
    """A package that is installed beside palpate: metadata with an entry point, as an installer writes it."""
    folder = tmp_path / "shapes-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: shapes\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(
        f"[{GROUP}]\nforeign = decimal:Decimal\nown = decimal:Decimal\nunmet = no_such_module:Shape\n"
    )
    monkeypatch.syspath_prepend(tmp_path)


def test_own_parts_come_first_and_take_precedence(another_package):
    assert part_names(GROUP, OWN) == ["own", "gone", "empty", "foreign", "unmet"]
    assert load_part(GROUP, "own", "shape", OWN).__name__ == "Fraction"
    assert load_part(GROUP, "foreign", "shape", OWN).__name__ == "Decimal"


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("gone", "No module named 'no_such_module'"),
        ("unmet", "No module named 'no_such_module'"),
        ("empty", "module 'fractions' has no attribute 'Shape'"),
    ],
)
def test_a_part_that_cannot_be_imported_is_refused_with_the_cause(another_package, name, cause):
    with pytest.raises(ConfigError) as refusal:
        load_part(GROUP, name, f"shape = {name!r}", OWN)
    assert str(refusal.value) == (
        f"shape = {name!r} cannot be imported ({cause}): repair or install the package that provides it"
    )


def test_an_unknown_part_is_refused_with_the_names_that_exist(another_package):
    with pytest.raises(ConfigError) as refusal:
        load_part(GROUP, "round", "shape = 'round'", {"own": OWN["own"]})
    assert str(refusal.value) == (
        "shape = 'round' is not one of own, foreign, unmet: correct the name, or install the package that "
        f"provides it (entry-point group {GROUP})"
    )


def test_a_group_without_parts_says_so():
    with pytest.raises(ConfigError, match=r"is not one of the installed ones \(there are none\): "):
        load_part(GROUP, "round", "shape = 'round'")
