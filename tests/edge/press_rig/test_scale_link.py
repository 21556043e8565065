"""Lines of common scales: sketches of the HX711 libraries, and serial scales that send continuously."""

from __future__ import annotations

import pytest

from palpate_edge.common.errors import RigError
from palpate_edge.press_rig.scale_link import ScaleLink

GRAM_N = 0.00980665


@pytest.mark.parametrize(
    ("line", "grams"),
    [
        (b"12.34\n", 12.34),
        (b"Reading: -0.5 g\r\n", -0.5),
        (b"one reading:\t3.2\n", 3.2),
        (b"ST,GS,+  102.5 g\r\n", 102.5),
        (b"1699, 250\n", 250.0),
    ],
)
def test_the_last_number_of_a_line_counts(line: bytes, grams: float) -> None:
    link = ScaleLink(GRAM_N, 2.0)
    link.receive(0, b"rest of a line\n")
    (reading,) = link.receive(5, line)
    assert reading.force_N == pytest.approx(grams * GRAM_N)
    assert reading.at_us == 5


def test_a_reading_in_two_pieces_is_one_reading() -> None:
    link = ScaleLink(1.0, 2.0)
    link.receive(0, b"\n")
    assert link.receive(1, b"12") == []
    assert [reading.force_N for reading in link.receive(2, b".5\n")] == [12.5]


def test_the_first_line_may_be_a_part_and_does_not_count() -> None:
    assert [one.force_N for one in ScaleLink(1.0, 2.0).receive(0, b"5.1\n105.2\n")] == [105.2]


def test_lines_without_a_number_are_no_readings() -> None:
    link = ScaleLink(1.0, 2.0)
    link.receive(0, b"\nload cell not found\n")
    link.check(1_900_000)
    link.receive(1_950_000, b"load cell not found\n")
    with pytest.raises(RigError, match=r"no reading for 2 s \(2 lines without a number\)"):
        link.check(2_100_000)
