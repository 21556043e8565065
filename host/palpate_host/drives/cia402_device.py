"""A CiA 402 joint drive as a device: slave core, and its axis or axes with their motors (drive_axis.py).

Pure: time and frames in, frames out. The motor is a simulated joint or a drive on another bus. Watchdog: in
Operation enabled and Quick stop active, a missing RPDO 1 (event timer 1400h:05) or the end of NMT OPERATIONAL
sets the torque to 0 at once and leads to Fault, in a node with several axes that of each. In Quick stop
active the torque is 0 too: a stopping hand must not keep closing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from palpate_bus.eds.cia402 import CIA402_EDS, DriveState
from palpate_bus.eds.cia402_axes import MAX_AXES, axes_dictionary, axis_index
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.slave import Slave, SlaveOutput
from palpate_host.drives.cia402_modes import OperationMode
from palpate_host.drives.drive_axis import SUPPORTED_MODES, DriveAxis, Motor

STATUS_TPDO = 2
LONGEST_STEP_US = 100_000  # a process that was suspended does not catch up
EVERY_MODE = tuple(OperationMode)


class DriveNode:
    """One CANopen node with the axes of one or several drives."""

    def __init__(self, slave: Slave, axes: Iterable[DriveAxis]) -> None:
        self.slave = slave
        self.axes = tuple(axes)
        self._now_us: int | None = None

    @property
    def is_following(self) -> bool:
        """True while a motor follows a velocity or a position, which also changes between frames (ramps,
        homing)."""
        return any(axis.is_following for axis in self.axes)

    def process(self, now_us: int, frames_in: Sequence[CanFrame]) -> SlaveOutput:
        """Measure the joints, process the frames, command the motors; return the frames to send."""
        step_us = 0 if self._now_us is None else min(now_us - self._now_us, LONGEST_STEP_US)
        self._now_us = now_us
        for axis in self.axes:
            axis.measure(now_us)
        served = self.slave.process(now_us, frames_in)
        for event in served.events:
            for axis in self.axes:
                axis.handle(event)
        for axis in self.axes:
            axis.drive(now_us, step_us * 1e-6)
        status = self.slave.process(now_us, ())
        return SlaveOutput(
            served.frames_out + status.frames_out, status.next_due_us, served.events + status.events
        )


class Cia402Device(DriveNode):
    """One drive with its motor; a change of its status sends TPDO 2."""

    def __init__(self, node_id: int, motor: Motor, modes: Sequence[OperationMode] = EVERY_MODE) -> None:
        """Make the drive. modes: the supported ones, of those that the EDS lists in 6502h."""
        slave = Slave(load_eds(CIA402_EDS, node_id))
        self._axis = DriveAxis(slave, motor, modes, status_tpdos=(STATUS_TPDO,))
        super().__init__(slave, [self._axis])

    @property
    def state(self) -> DriveState:
        return self._axis.state

    @property
    def torque_per_mille(self) -> int:
        """The motor's torque in a torque mode: the target, limited by 6072h and 6073h; 0 in other modes."""
        return self._axis.torque_per_mille

    @property
    def per_mille_Nm(self) -> float:
        return self._axis.per_mille_Nm

    @property
    def increments_per_rad(self) -> float:
        return self._axis.increments_per_rad


class Cia402AxesDevice(DriveNode):
    """Up to eight drives in one node on a CAN FD bus. Its EMCY has the axis in the first manufacturer byte.

    An axis without a motor supports no mode (6502h is 0).
    """

    def __init__(
        self, node_id: int, motors: Mapping[int, Motor], modes: Sequence[OperationMode] = EVERY_MODE
    ) -> None:
        """Make the node. motors: by axis, from 0 on. Raises ConfigError for an axis that CiA 402 lacks."""
        beyond = [axis for axis in motors if axis not in range(MAX_AXES)]
        if beyond:
            raise ConfigError(
                f"node 0x{node_id:02X} has no axis {beyond[0]}: give its joints axes from 0 to {MAX_AXES - 1}"
            )
        slave = Slave(axes_dictionary(node_id))
        super().__init__(
            slave,
            [
                DriveAxis(slave, motor, modes, axis=axis, error_info=bytes([axis]))
                for axis, motor in sorted(motors.items())
            ],
        )
        for axis in range(MAX_AXES):
            if axis not in motors:
                slave.write(axis_index(SUPPORTED_MODES, axis), 0, 0)
