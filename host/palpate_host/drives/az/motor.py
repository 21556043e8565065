"""Register values of one AZ axis: direct data from an order, joint motion from the reply. Pure.

Torque is proportional to the operating current; full current gives the motor's torque. The default motor is
Table 4's AZM24AK: 0.36 deg a step, 20:1, 0.095 N m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from palpate_edge.common.errors import BusError
from palpate_host.drives.az.registers import (
    ACCELERATION,
    DATA_NUMBER,
    DECELERATION,
    DIRECT_DATA,
    FEEDBACK_POSITION,
    FEEDBACK_SPEED,
    OPERATING_CURRENT,
    OPERATION_TYPE,
    POSITION,
    SPEED,
    TORQUE,
    TRIGGER,
    OperationType,
    Trigger,
    from_words,
    to_words,
)

FULL_CURRENT = 1000  # per mille; the unit of OPERATING_CURRENT and of TORQUE
MOTION_FIRST = FEEDBACK_POSITION.address
MOTION_WORDS = TORQUE.address + 2 - FEEDBACK_POSITION.address
HIGHEST_RATE = 1_000_000  # 1 kHz/s is 1000


@dataclass(frozen=True, slots=True)
class AzMotor:
    """A motor with its gear, in quantities at the joint.

    steps_per_turn: of the joint. torque_Nm: at the joint with full current. speed_rad_s: limit in every mode.
    rate_rad_s2: largest change of speed.
    """

    steps_per_turn: int = 20_000
    torque_Nm: float = 1.9
    speed_rad_s: float = 2.0
    rate_rad_s2: float = 50.0

    def to_rad(self, steps: float) -> float:
        return steps * math.tau / self.steps_per_turn

    def to_steps(self, angle_rad: float) -> int:
        return round(angle_rad * self.steps_per_turn / math.tau)

    def to_current(self, torque_Nm: float) -> int:
        """Return the per mille of the current for a torque, rounded down so that no limit is exceeded."""
        return min(math.floor(abs(torque_Nm) / self.torque_Nm * FULL_CURRENT), FULL_CURRENT)


@dataclass(frozen=True, slots=True)
class AzMotion:
    """The measured motion of an axis, at the joint in the drive's own direction."""

    position_rad: float
    velocity_rad_s: float
    torque_Nm: float


def torque_operation(motor: AzMotor, torque_Nm: float) -> list[int]:
    """Return the direct data of a torque, 16 words; the sign is that of the speed limit."""
    speed = math.copysign(motor.speed_rad_s, torque_Nm)
    return _direct_data(motor, OperationType.CONTINUOUS_TORQUE, 0.0, speed, motor.to_current(torque_Nm))


def velocity_operation(motor: AzMotor, velocity_rad_s: float, torque_limit_Nm: float) -> list[int]:
    """Return the direct data of a velocity with a torque limit, 16 words."""
    velocity = max(-motor.speed_rad_s, min(motor.speed_rad_s, velocity_rad_s))
    current = motor.to_current(torque_limit_Nm)
    return _direct_data(motor, OperationType.CONTINUOUS_SPEED, 0.0, velocity, current)


def position_operation(motor: AzMotor, position_rad: float, torque_limit_Nm: float) -> list[int]:
    """Return the direct data of an absolute position with a torque limit, 16 words."""
    current = motor.to_current(torque_limit_Nm)
    return _direct_data(motor, OperationType.ABSOLUTE_POSITIONING, position_rad, motor.speed_rad_s, current)


def motion(motor: AzMotor, words: Sequence[int]) -> AzMotion:
    """Decode the MOTION_WORDS registers from MOTION_FIRST on. Raises BusError for another number of them."""
    if len(words) != MOTION_WORDS:
        raise BusError(f"{len(words)} registers in the response, {MOTION_WORDS} were requested")

    def value(address: int) -> int:
        first = address - MOTION_FIRST
        return from_words(words[first : first + 2])[0]

    return AzMotion(
        position_rad=motor.to_rad(value(FEEDBACK_POSITION.address)),
        velocity_rad_s=motor.to_rad(value(FEEDBACK_SPEED.address)),
        torque_Nm=value(TORQUE.address) * motor.torque_Nm / FULL_CURRENT,
    )


def _direct_data(
    motor: AzMotor, operation: OperationType, position_rad: float, speed_rad_s: float, current: int
) -> list[int]:
    rate = max(1, min(HIGHEST_RATE, motor.to_steps(motor.rate_rad_s2)))  # Hz/s = 0.001 kHz/s
    values = {
        DATA_NUMBER: 0,
        OPERATION_TYPE: int(operation),
        POSITION: motor.to_steps(position_rad),
        SPEED: motor.to_steps(speed_rad_s),
        ACCELERATION: rate,
        DECELERATION: rate,
        OPERATING_CURRENT: current,
        TRIGGER: int(Trigger.ALL),
    }
    return to_words([values[register] for register in DIRECT_DATA])
