"""Simulated AZ drive with its joint as a register file; time is an argument. `az_server` serves it.

Modelled: the three operation types that a joint uses, acceleration and current limits, the inputs STOP, FREE,
ZHOME and ALM-RST, and the communication timeout with alarm 85h. Tests can raise alarms and set temperatures.
Registers outside the table do not exist.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from palpate_host.drives.az import alarms
from palpate_host.drives.az import registers as az
from palpate_host.drives.az.motor import FULL_CURRENT, AzMotor
from palpate_host.drives.az.registers import AzStatus, Input, OperationType, Trigger, from_words, to_words
from palpate_twin.drives.drive_plant import JointParameters, JointPlant

LONGEST_STEP_US = 1_000
# A stepper follows its command within its torque limit; the time constant of 2 ms is an assumption.
FOLLOWS_WITHIN_S = 0.002
POSITION_GAIN_per_s = 20.0
AMBIENT_degC = 30.0

_REGISTERS = (
    *az.DIRECT_DATA,
    az.FORWARDING,
    az.INPUT_COMMAND,
    az.OUTPUT_STATUS,
    az.PRESENT_ALARM,
    az.COMMAND_POSITION,
    az.FEEDBACK_POSITION,
    az.FEEDBACK_SPEED_RPM,
    az.FEEDBACK_SPEED,
    az.TORQUE,
    az.DRIVER_TEMPERATURE,
    az.MOTOR_TEMPERATURE,
    az.COMMUNICATION_TIMEOUT,
)
_WRITABLE = (*az.DIRECT_DATA, az.FORWARDING, az.INPUT_COMMAND, az.COMMUNICATION_TIMEOUT)


class SimulatedAz:
    """One drive. values: its registers, address -> signed 32-bit value."""

    def __init__(self, motor: AzMotor | None = None, joint: JointParameters | None = None) -> None:
        self.motor = motor or AzMotor()
        self.plant = JointPlant(joint or JointParameters())
        self.alarm = 0
        self.driver_degC = self.motor_degC = AMBIENT_degC
        self._is_home = False
        self._held = Input(0)
        self.values = {register.address: 0 for register in _REGISTERS}
        self._operation: Mapping[int, int] | None = None
        self._target_rad_s = 0.0
        self._torque_Nm = 0.0
        self._now_us: int | None = None
        self._last_message_us: int | None = None

    @property
    def torque_Nm(self) -> float:
        """Current motor torque at the joint."""
        return self._torque_Nm

    def readable(self, address: int, count: int) -> bool:
        """Return whether `count` words from `address` begin and end with complete registers."""
        return count % 2 == 0 and address in self.values and address + count - 2 in self.values

    def writable(self, address: int, count: int) -> bool:
        """Return whether `count` words from `address` are complete writable registers."""
        known = {register.address for register in _WRITABLE}
        return count % 2 == 0 and all(address + i in known for i in range(0, count, 2))

    def write(self, now_us: int, address: int, words: Sequence[int]) -> None:
        """Write complete 32-bit registers; trigger and input command take effect immediately."""
        self.advance(now_us)
        self._last_message_us = now_us
        written = dict(zip(range(address, address + len(words), 2), from_words(words), strict=True))
        self.values |= written
        if az.INPUT_COMMAND.address in written:
            self._take_inputs()
        if written.get(az.TRIGGER.address) == Trigger.ALL and self._may_move:
            self._operation = {register.address: self.values[register.address] for register in az.DIRECT_DATA}

    def read(self, now_us: int, address: int, count: int) -> list[int]:
        """Return `count` words from `address`; gaps between registers read as 0."""
        self.advance(now_us)
        self._last_message_us = now_us
        self._measure()
        return to_words([self.values.get(a, 0) for a in range(address, address + count, 2)])

    def raise_alarm(self, code: int) -> None:
        """Raise an alarm, which ends the operation and switches the current off."""
        self.alarm = code
        self._operation = None

    def advance(self, now_us: int) -> None:
        """Advance the joint to `now_us` and check the communication timeout."""
        if self._now_us is None:
            self._now_us = now_us
        while self._now_us < now_us:
            step_us = min(LONGEST_STEP_US, now_us - self._now_us)
            self._now_us += step_us
            timeout_ms = self.values[az.COMMUNICATION_TIMEOUT.address]
            message_us = self._last_message_us
            if timeout_ms > 0 and message_us is not None and self._now_us - message_us > timeout_ms * 1000:
                self._last_message_us = None
                self.raise_alarm(alarms.COMMUNICATION_TIMEOUT)
            self._torque_Nm = self._motor_torque(step_us * 1e-6)
            self.plant.advance(step_us, self._torque_Nm)

    @property
    def _inputs(self) -> Input:
        return Input(self.values[az.INPUT_COMMAND.address] & 0xFFFF & ~7)

    @property
    def _may_move(self) -> bool:
        return not self.alarm and not self._inputs & (Input.FREE | Input.STOP)

    def _take_inputs(self) -> None:
        if self._inputs & Input.ALM_RST:
            self.alarm = 0
        if self._inputs & (Input.FREE | Input.STOP):
            self._operation = None
        if self._inputs & ~self._held & Input.ZHOME and self._may_move:
            self._is_home = False
            self._operation = {
                az.OPERATION_TYPE.address: OperationType.ABSOLUTE_POSITIONING,
                az.POSITION.address: 0,
                az.SPEED.address: self.motor.to_steps(self.motor.speed_rad_s),
            }
        self._held = self._inputs

    def _motor_torque(self, step_s: float) -> float:
        """Return the torque of the current operation; without one, the joint is held unless FREE or alarm."""
        if self.alarm or self._inputs & Input.FREE:
            self._target_rad_s = 0.0
            return 0.0
        operation = self._operation or {}
        limit_Nm = (
            operation.get(az.OPERATING_CURRENT.address, FULL_CURRENT) * self.motor.torque_Nm / FULL_CURRENT
        )
        speed_rad_s = self.motor.to_rad(operation.get(az.SPEED.address, 0))
        kind = operation.get(az.OPERATION_TYPE.address)
        if kind == OperationType.CONTINUOUS_TORQUE:
            desired_rad_s = speed_rad_s
        elif kind == OperationType.ABSOLUTE_POSITIONING:
            error_rad = self.motor.to_rad(operation[az.POSITION.address]) - self.plant.position_rad
            desired_rad_s = max(-abs(speed_rad_s), min(abs(speed_rad_s), POSITION_GAIN_per_s * error_rad))
        else:
            desired_rad_s = speed_rad_s if kind == OperationType.CONTINUOUS_SPEED else 0.0
        rate = self.motor.to_rad(operation.get(az.ACCELERATION.address, 0)) or self.motor.rate_rad_s2
        step_rad_s = rate * step_s
        change = max(-step_rad_s, min(step_rad_s, desired_rad_s - self._target_rad_s))
        self._target_rad_s += change
        return max(-limit_Nm, min(limit_Nm, self._torque_to_follow(self._target_rad_s)))

    def _torque_to_follow(self, target_rad_s: float) -> float:
        joint, plant = self.plant.parameters, self.plant
        load_Nm = joint.load_stiffness_Nm_rad * (plant.position_rad - joint.grasp_rad)
        friction_Nm = (joint.friction_Nms_rad + joint.load_damping_Nms_rad) * target_rad_s
        change_rad_s = target_rad_s - plant.velocity_rad_s
        return joint.inertia_kgm2 * change_rad_s / FOLLOWS_WITHIN_S + friction_Nm + load_Nm

    def _measure(self) -> None:
        motor, plant = self.motor, self.plant
        self.values[az.FEEDBACK_POSITION.address] = motor.to_steps(plant.position_rad)
        self.values[az.COMMAND_POSITION.address] = motor.to_steps(plant.position_rad)
        self.values[az.FEEDBACK_SPEED.address] = motor.to_steps(plant.velocity_rad_s)
        self.values[az.FEEDBACK_SPEED_RPM.address] = round(
            plant.velocity_rad_s * 60 / math.tau * plant.parameters.gear_ratio
        )
        self.values[az.TORQUE.address] = round(self._torque_Nm / motor.torque_Nm * FULL_CURRENT)
        self.values[az.PRESENT_ALARM.address] = self.alarm
        self.values[az.DRIVER_TEMPERATURE.address] = round(self.driver_degC / az.DRIVER_TEMPERATURE.scale)
        self.values[az.MOTOR_TEMPERATURE.address] = round(self.motor_degC / az.MOTOR_TEMPERATURE.scale)
        is_at_zero = self.values[az.FEEDBACK_POSITION.address] == 0
        if is_at_zero and Input.ZHOME in self._held and self._operation is not None:
            self._is_home, self._operation = True, None
        status = AzStatus.HOME_END if self._is_home else AzStatus(0)
        if self.alarm:
            status |= AzStatus.ALM_A
        elif self._operation is not None:
            status |= AzStatus.MOVE
        else:
            status |= AzStatus.READY | AzStatus.IN_POS
        self.values[az.OUTPUT_STATUS.address] = int(status)
