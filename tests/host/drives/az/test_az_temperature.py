"""The limit of an AZ axis' temperature at its edges, and whose temperatures are asked when."""

from __future__ import annotations

from collections import Counter

import pytest

from palpate_host.drives.az.axis import ExtraRead
from palpate_host.drives.az.gateway import extra_read
from palpate_host.drives.az.temperature import AzTemperatures, TemperatureLimit


def hot_after(*temperatures_degC: tuple[float, float]) -> list[bool]:
    limit, said = TemperatureLimit(75.0), []
    for driver_degC, motor_degC in temperatures_degC:
        limit.take(AzTemperatures(driver_degC, motor_degC))
        said.append(limit.is_exceeded)
    return said


def test_the_limit_itself_is_allowed_and_a_tenth_more_is_not() -> None:
    assert hot_after((30.0, 75.0), (30.0, 75.1)) == [False, True]


def test_what_was_too_hot_cools_by_5_K_first() -> None:
    assert hot_after((30.0, 76.0), (30.0, 75.0), (30.0, 70.1), (30.0, 70.0), (30.0, 75.0)) == [
        True, True, True, False, False,
    ]  # fmt: skip


def test_the_hotter_of_drive_and_motor_counts() -> None:
    assert hot_after((80.0, 30.0), (60.0, 72.0), (72.0, 60.0), (60.0, 60.0)) == [True, True, True, False]


@pytest.mark.parametrize("axes", [1, 2, 3, 9])
def test_every_axis_is_asked_in_turn_and_one_a_round(axes: int) -> None:
    """In n (n + 1) rounds n times its status and alarm and once its temperatures."""
    asked = Counter(extra_read(number, axes) for number in range(axes * (axes + 1)))
    assert asked == {
        **{(axis, ExtraRead.HEALTH): axes for axis in range(axes)},
        **{(axis, ExtraRead.TEMPERATURES): 1 for axis in range(axes)},
    }
