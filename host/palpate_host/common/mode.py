"""The host's modes: what it does with the joints."""

from __future__ import annotations

import enum


class Mode(enum.Enum):
    """Mode of the host."""

    INIT = "init"  # nodes are missing: drives off
    CHECK = "check"  # all nodes found: the drives are identified, the nodes started
    HOME = "home"  # drives without a zero are homed
    READY = "ready"  # drives are enabled, torque 0; waits for the first frames and for a command
    GRASP = "grasp"  # closing and holding: u_sg
    HOLD = "hold"  # u_sg, or the last forces of the pose law: turning is not possible now
    MANIPULATE = "manipulate"  # Eqs. (9)-(16), contacts correct the desired frame
    BLIND = "blind"  # Eqs. (9)-(14), desired frame frozen or by joint angles alone
    RELEASE = "release"  # opening, for a time
    FAULT = "fault"  # after a fault: torque 0, drives quick-stopped, then off
    STOP = "stop"  # stopped by the operator: the same
    UNKNOWN = ""  # not in the recording; the host never enters it


STOPPED = (Mode.FAULT, Mode.STOP)


STARTING = (Mode.INIT, Mode.CHECK, Mode.HOME, Mode.READY)


MOVING = (Mode.GRASP, Mode.HOLD, Mode.MANIPULATE, Mode.BLIND, Mode.RELEASE)
