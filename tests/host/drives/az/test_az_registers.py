"""Words and direct data of the AZ drive, against byte layouts worked out by hand."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.common.errors import BusError
from palpate_host.drives.az import alarms, motor
from palpate_host.drives.az.registers import from_words, to_words

MOTOR = motor.AzMotor()


def test_high_word_comes_first() -> None:
    assert to_words([0x12345678, -1]) == [0x1234, 0x5678, 0xFFFF, 0xFFFF]


@given(st.lists(st.integers(-(2**31), 2**31 - 1), max_size=20))
def test_words_come_back(values: list[int]) -> None:
    assert from_words(to_words(values)) == values


@given(st.lists(st.integers(0, 0xFFFF), max_size=9).filter(lambda words: len(words) % 2 == 1))
def test_half_a_value_is_refused(words: list[int]) -> None:
    with pytest.raises(BusError, match="not whole"):
        from_words(words)


@pytest.mark.parametrize("value", [2**31, -(2**31) - 1])
def test_too_large_a_value_is_refused(value: int) -> None:
    with pytest.raises(BusError, match="does not fit"):
        to_words([value])


def test_direct_data_of_a_velocity() -> None:
    """1 rad/s at 20,000 steps a turn is 3183 Hz; 0.95 of 1.9 N m is 50.0 % current; type 16, trigger 1."""
    values = from_words(motor.velocity_operation(MOTOR, 1.0, 0.95))
    assert values == [0, 16, 0, 3183, 159_155, 159_155, 500, 1]


def test_direct_data_of_a_torque_has_its_sign_in_the_speed() -> None:
    values = from_words(motor.torque_operation(MOTOR, -0.19))
    assert values[1] == 18
    assert values[3] == -6366
    assert values[6] in (99, 100)  # rounded down: never more than asked


def test_direct_data_of_a_position() -> None:
    values = from_words(motor.position_operation(MOTOR, 3.141592653589793, 1.9))
    assert (values[1], values[2], values[6]) == (1, 10_000, 1000)


@given(st.floats(-1e3, 1e3), st.floats(0, 1e3))
def test_limits_hold_for_any_order(velocity_rad_s: float, torque_Nm: float) -> None:
    values = from_words(motor.velocity_operation(MOTOR, velocity_rad_s, torque_Nm))
    assert abs(values[3]) <= 6366  # 2 rad/s
    assert 0 <= values[6] <= 1000


def test_motion_reads_position_speed_and_torque() -> None:
    """00CC..00D7: position 5000 = a quarter turn, speed at 00D0 -20000 Hz = -1 turn/s, torque 25.0 %."""
    words = to_words([5000, 0, -20_000, 0, 0, 250])
    motion = motor.motion(MOTOR, words)
    assert motion.position_rad == pytest.approx(1.5707963)
    assert motion.velocity_rad_s == pytest.approx(-6.2831853)
    assert motion.torque_Nm == pytest.approx(0.475)


def test_motion_of_too_few_words_is_refused() -> None:
    with pytest.raises(BusError, match="10 registers in the response, 12 were requested"):
        motor.motion(MOTOR, [0] * 10)


def test_alarm_texts() -> None:
    assert alarms.text(0x85) == "alarm 85h (RS-485 communication timeout)"
    assert "see the manual" in alarms.text(0xEE)
