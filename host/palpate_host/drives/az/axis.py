"""One AZ axis between the CiA 402 device, which sets orders, and the port's thread, which carries them out.

Only the newest order counts; an older one that was not carried out is dropped. Pure except for the lock: the
time is an argument.
"""

from __future__ import annotations

import contextlib
import enum
import threading
from dataclasses import dataclass, replace

from palpate_edge.common.errors import BusError
from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.drives.az import alarms
from palpate_host.drives.az import motor as az
from palpate_host.drives.az.motor import AzMotor
from palpate_host.drives.az.port import AzPort
from palpate_host.drives.az.registers import AzStatus, Input
from palpate_host.drives.az.temperature import TemperatureLimit
from palpate_host.drives.cia402_motion import MotorState, OwnHoming

ORDER_LIMIT_US = 200_000
"""Age at which an order is no longer carried out: the joint brakes."""
FAILURE_LIMIT = 3
"""Failed transactions in a row after which the axis is lost."""
TEMPERATURE_AGE_LIMIT_US = 5_000_000
"""Age of the last temperatures at which the axis is lost, even if it moves."""
EXCESS_TEMPERATURE = 0x4310  # CiA 402-2, error codes: excess temperature drive
COMMUNICATION_ERROR = 0x7500  # CiA 402-2, error codes: communication
MANUFACTURER_ERROR = 0xFF00  # the same: manufacturer specific; the alarm's code is its low byte


class TorqueBy(enum.Enum):
    """The way an axis follows a torque.

    CURRENT: the drive's torque operation. ADMITTANCE: the joint turns with torque / B_d, which makes a geared
    stepper compliant although its friction exceeds the torques of a hand.
    """

    CURRENT = "current"
    ADMITTANCE = "admittance"


class ExtraRead(enum.Enum):
    """A read in addition to an axis' motion."""

    HEALTH = "status and alarm"
    TEMPERATURES = "temperatures"


@dataclass(frozen=True, slots=True)
class AxisSettings:
    """One axis of az.toml. device_id: Modbus address. torque_limit_Nm: enforced by the operating current.

    temperature_limit_degC: above it, in drive or motor, the axis is in Fault.
    """

    device_id: int
    motor: AzMotor
    torque_limit_Nm: float
    torque_by: TorqueBy = TorqueBy.ADMITTANCE
    B_d_Nms_rad: float = 0.4
    temperature_limit_degC: float = 75.0


class AzAxis:
    """The Motor of a Cia402Device whose joint is moved by an AZ drive."""

    def __init__(self, settings: AxisSettings) -> None:
        self.settings = settings
        self.rated_torque_mNm = round(settings.motor.torque_Nm * 1000)
        self.problem = "no response yet"
        self._lock = threading.Lock()
        self._command = JointCommand(DriveGoal.OFF)
        self._ordered_us: int | None = None
        self._state = MotorState(0.0, 0.0)
        self._inputs: Input | None = None
        self._reset = False
        self._failures = 0
        self._has_reported = False
        self._temperature = TemperatureLimit(settings.temperature_limit_degC)
        self._measured_us: int | None = None

    def state(self, now_us: int) -> MotorState:  # noqa: ARG002 - the newest response, of any age
        with self._lock:
            return self._state

    def order(self, now_us: int, command: JointCommand) -> None:
        with self._lock:
            self._command = command
            self._ordered_us = now_us

    def reset_fault(self) -> None:
        """Forget the error; the next exchange resets the drive's alarm, and a lasting one is reported
        again."""
        with self._lock:
            self._reset = True
            self._failures = 0
            self._state = replace(self._state, error_code=self._state.lasting_error)

    @property
    def has_reported(self) -> bool:
        """True once the drive has reported its joint's position."""
        return self._has_reported

    def measure(self, now_us: int, port: AzPort) -> None:
        """Read the temperatures; excess temperature is an error that lasts until the axis has cooled."""
        temperatures = port.temperatures(self.settings.device_id)
        was_exceeded = self._temperature.is_exceeded
        self._temperature.take(temperatures)
        self._measured_us = now_us
        with self._lock:
            is_exceeded = self._temperature.is_exceeded
            self._state = replace(self._state, lasting_error=EXCESS_TEMPERATURE if is_exceeded else 0)
            if is_exceeded and not was_exceeded:
                self.problem = (
                    f"drive at {temperatures.driver_degC} degC, motor at {temperatures.motor_degC} degC:"
                    f" temperature_limit_degC is {self.settings.temperature_limit_degC}"
                )
                self._state = replace(self._state, error_code=EXCESS_TEMPERATURE)

    def exchange(self, now_us: int, port: AzPort, extra: ExtraRead | None) -> None:
        """Carry out the newest order and read the motion; a failure is counted and becomes an error."""
        with self._lock:
            command, reset, self._reset = self._command, self._reset, False
            if self._ordered_us is None or now_us - self._ordered_us > ORDER_LIMIT_US:
                command = JointCommand(DriveGoal.QUICK_STOP)
        try:
            if reset:
                port.command(self.settings.device_id, Input.ALM_RST)
                self._inputs = None
            words = self._carry_out(command, port)
            is_homing = command.goal is DriveGoal.HOME
            reads_health = extra is ExtraRead.HEALTH or reset or is_homing
            health = port.health(self.settings.device_id) if reads_health else None
            if extra is ExtraRead.TEMPERATURES:
                self.measure(now_us, port)
        except BusError as exc:
            self._count_failure(str(exc))
            return
        self._take_motion(words, health.alarm if health else None)
        self._check_temperature_age(now_us)
        if is_homing and health is not None:
            self._check_homing(health.status)

    def release(self, port: AzPort) -> None:
        """Free the joint at the end; a drive that misses the command stops by its own timeout."""
        with contextlib.suppress(BusError):
            port.command(self.settings.device_id, Input.FREE)

    def _carry_out(self, command: JointCommand, port: AzPort) -> list[int]:
        device_id, motor = self.settings.device_id, self.settings.motor
        if command.goal is DriveGoal.HOME:
            return self._go_home(port)
        self._set_homing(OwnHoming.NONE)
        inputs = {DriveGoal.OFF: Input.FREE, DriveGoal.QUICK_STOP: Input.STOP}.get(command.goal, Input(0))
        if inputs != self._inputs:
            self._inputs = None
            port.command(device_id, inputs)
            self._inputs = inputs
        if inputs:
            return list(port.motion(device_id))
        limit_Nm = self.settings.torque_limit_Nm
        if command.goal is DriveGoal.VELOCITY:
            cap_Nm = min(limit_Nm, command.torque_Nm)
            return list(port.move(device_id, az.velocity_operation(motor, command.velocity_rad_s, cap_Nm)))
        if command.goal is DriveGoal.POSITION:
            cap_Nm = min(limit_Nm, command.torque_Nm)
            return list(port.move(device_id, az.position_operation(motor, command.position_rad, cap_Nm)))
        torque_Nm = max(-limit_Nm, min(limit_Nm, command.torque_Nm))
        if self.settings.torque_by is TorqueBy.CURRENT:
            return list(port.move(device_id, az.torque_operation(motor, torque_Nm)))
        velocity_rad_s = torque_Nm / self.settings.B_d_Nms_rad
        return list(port.move(device_id, az.velocity_operation(motor, velocity_rad_s, limit_Nm)))

    def _go_home(self, port: AzPort) -> list[int]:
        """Trigger ZHOME, the drive's return to its own zero, once.

        When the response is lost, homing has failed: it is unknown whether the drive moves, and the trigger
        is not repeated.
        """
        if self._state.homing is OwnHoming.NONE:
            self._inputs = None
            try:
                port.command(self.settings.device_id, Input(0))  # ZHOME acts on its rising edge
                port.command(self.settings.device_id, Input.ZHOME)
            except BusError:
                self._set_homing(OwnHoming.FAILED)
                raise
            self._inputs = Input.ZHOME
            self._set_homing(OwnHoming.RUNNING)
        return list(port.motion(self.settings.device_id))

    def _check_homing(self, status: AzStatus) -> None:
        if (
            self._state.homing is OwnHoming.RUNNING
            and AzStatus.HOME_END in status
            and AzStatus.MOVE not in status
        ):
            self._set_homing(OwnHoming.ATTAINED)

    def _set_homing(self, homing: OwnHoming) -> None:
        with self._lock:
            self._state = replace(self._state, homing=homing)

    def _take_motion(self, words: list[int], alarm: int | None) -> None:
        motion = az.motion(self.settings.motor, words)
        with self._lock:
            self._has_reported = True
            self._failures = 0
            error_code = self._state.error_code
            if alarm:
                self.problem, error_code = alarms.text(alarm), MANUFACTURER_ERROR | alarm
            elif not error_code:
                self.problem = ""
            self._state = replace(
                self._state,
                position_rad=motion.position_rad,
                velocity_rad_s=motion.velocity_rad_s,
                torque_Nm=motion.torque_Nm,
                error_code=error_code,
            )

    def _check_temperature_age(self, now_us: int) -> None:
        if self._measured_us is None or now_us - self._measured_us > TEMPERATURE_AGE_LIMIT_US:
            with self._lock:
                self.problem = "its temperatures cannot be read"
                self._state = replace(self._state, error_code=COMMUNICATION_ERROR)

    def _count_failure(self, problem: str) -> None:
        with self._lock:
            self._inputs = None  # it is unknown whether they arrived
            self._failures += 1
            if self._failures >= FAILURE_LIMIT:
                self.problem = problem
                self._state = replace(self._state, error_code=COMMUNICATION_ERROR)
