"""The robot type ``palpate_hand``: joints, contacts and pictures in, orientations of the held object out.

The host keeps every limit: it checks each command against its mode and its supervisor. An action is the
object's orientation relative to the one at `connect`; the host has no mode for targets of single joints.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_already_connected, check_if_not_connected

from lerobot_robot_palpate.configs import PalpateHandConfig
from lerobot_robot_palpate.control_socket import (
    HostConnection,
    HostState,
    PalpateHandError,
    default_control_socket,
)
from lerobot_robot_palpate.observations import contact_values, joint_values
from lerobot_robot_palpate.picture_ring import PictureRing
from lerobot_robot_palpate.rotations import RPY, Matrix, angle_deg, from_rpy_deg, to_rpy_deg
from lerobot_robot_palpate.status_reader import StatusReader

ORIENTATION = tuple(f"object.{name}" for name in RPY)
POLL_S = 0.02
SMALLEST_TURN_DEG = 0.01
HOLDING = ("grasp", "hold", "manipulate")
STOPPED = ("fault", "stop")


class PalpateHand(Robot):
    """A hand behind a running host, on this machine."""

    config_class = PalpateHandConfig
    name = "palpate_hand"

    def __init__(self, config: PalpateHandConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras = {finger: PictureRing(Path(path)) for finger, path in config.rings.items()}
        self._path = Path(config.control_socket) if config.control_socket else default_control_socket()
        self._host: HostConnection | None = None
        self._statuses: StatusReader | None = None
        self._zero: Matrix = np.eye(3)
        self._sent: tuple[float, ...] | None = None
        self._observed: HostState | None = None

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        """Names and types of an observation. The host gives the joints and fingers, so it has to run."""
        host = self._host or HostConnection(self._path, self.config.timeout_s)
        try:
            status = host.ask("status")
        finally:
            if host is not self._host:
                host.close()
        names = (*joint_values(status, required=False), *contact_values(status), *ORIENTATION)
        pictures = {finger: ring.shape for finger, ring in self.cameras.items()}
        return dict.fromkeys(names, float) | pictures

    @property
    def action_features(self) -> dict[str, Any]:
        """Roll, pitch and yaw of the object in degrees, relative to its orientation at `connect`."""
        return dict.fromkeys(ORIENTATION, float)

    @property
    def is_connected(self) -> bool:
        return self._host is not None

    @property
    def is_calibrated(self) -> bool:
        return True

    def calibrate(self) -> None:
        """Do nothing: the fingertips' calibrations belong to their boards, joint zeros to hand.toml."""

    def configure(self) -> None:
        """Do nothing: the host is configured by hand.toml."""

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:  # noqa: ARG002 - LeRobot's signature
        """Connect, grasp the object unless it is held already, and take its orientation as zero.

        Raises PalpateHandError in FAULT or STOP (a person has to recover the hand), and when the fingers do
        not touch within `timeout_s`.
        """
        host = HostConnection(self._path, self.config.timeout_s)
        try:
            if host.ask("status")["mode"] not in HOLDING:
                host.ask("grasp")
            self._wait(host, _is_held, "touch the object with every finger")
            if host.ask("status")["R_d"] is None:
                host.ask("rotate", rpy_deg=[0.0, 0.0, 0.0], ramp_s=0.0)
            status = self._wait(host, _is_at_rest, "come to rest")
            self._statuses = StatusReader(self._path, self.config.timeout_s)
        except BaseException:
            host.close()
            raise
        self._host, self._zero, self._sent, self._observed = host, np.array(status["R_d"]), None, None

    @check_if_not_connected
    def get_observation(self) -> dict[str, Any]:
        """Return joints, contacts, orientation of the object and the newest pictures.

        Raises PalpateHandError in FAULT and STOP, with the host's reason, and when a value is not known.
        """
        assert self._statuses is not None
        status = self._statuses.newest()
        _check_running(status)
        if status["R_c"] is None:
            raise PalpateHandError(
                f"the object's orientation is not known in mode {status['mode']}: grasp it again"
            )
        self._observed = status
        turned = to_rpy_deg(np.array(status["R_c"]) @ self._zero.T)
        values = joint_values(status) | contact_values(status) | dict(zip(ORIENTATION, turned, strict=True))
        return values | {finger: ring.newest() for finger, ring in self.cameras.items()}

    @check_if_not_connected
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Turn the object to an orientation at `speed_deg_s`; a new target replaces the one under way.

        The first action after an observation takes its status. Returns the action. Raises PalpateHandError,
        with the host's reason, when the host refuses the turn.
        """
        assert self._host is not None and self._statuses is not None
        target = tuple(float(action[name]) for name in ORIENTATION)
        if not all(map(math.isfinite, target)):
            raise PalpateHandError(f"action {target} is not a number of degrees")
        status, self._observed = self._observed or self._statuses.newest(), None
        _check_running(status)
        if status["R_d"] is None:
            raise PalpateHandError(f"the host has dropped its target in mode {status['mode']}: connect again")
        turn = from_rpy_deg(*target) @ self._zero @ np.array(status["R_d"]).T
        angle = angle_deg(turn)
        is_under_way = target == self._sent and (status["turned"] or 0.0) < 1.0
        if angle > SMALLEST_TURN_DEG and not is_under_way:
            ramp_s = angle / self.config.speed_deg_s
            response = self._host.ask("rotate", rpy_deg=to_rpy_deg(turn), ramp_s=ramp_s)
            self._statuses.pass_by(response)
            self._sent = target
        return dict(zip(ORIENTATION, target, strict=True))

    @check_if_not_connected
    def disconnect(self) -> None:
        """Disconnect. The host finishes the turn under way and holds on, or opens the hand with `release`."""
        assert self._host is not None and self._statuses is not None
        host, self._host = self._host, None
        try:
            self._statuses.close()
            if self.config.release:
                host.ask("release")
        finally:
            host.close()

    def _wait(self, host: HostConnection, condition: Callable[[HostState], bool], what: str) -> HostState:
        end_s = time.monotonic() + self.config.timeout_s
        while not condition(status := host.ask("status")):
            _check_running(status)
            if time.monotonic() > end_s:
                raise PalpateHandError(
                    f"the hand did not {what} within {self.config.timeout_s:g} s"
                    f" ({status['mode']}: {status['reason']})"
                )
            time.sleep(POLL_S)
        return status


def _is_held(status: HostState) -> bool:
    touches = all(finger["in_contact"] for finger in status["fingers"])
    return status["mode"] in HOLDING and touches and status["R_c"] is not None


def _is_at_rest(status: HostState) -> bool:
    return status["R_d"] is not None and status["turned"] == 1.0


def _check_running(status: HostState) -> None:
    if status["mode"] in STOPPED:
        raise PalpateHandError(
            f"{status['mode']}: {status['reason']}: remove the cause, then palpate-host command recover"
        )
