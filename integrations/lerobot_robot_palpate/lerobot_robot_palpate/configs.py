"""Configurations of the plug-in's robot and teleoperators, as LeRobot's command line sets them."""

from __future__ import annotations

from dataclasses import dataclass, field

from lerobot.robots import RobotConfig
from lerobot.teleoperators import TeleoperatorConfig


@RobotConfig.register_subclass("palpate_hand")
@dataclass(kw_only=True)
class PalpateHandConfig(RobotConfig):
    """A hand behind a running host.

    control_socket: path; empty for $PALPATE_CONTROL, or the default of `palpate-host run`. rings: finger ->
    path of its ring of frames. speed_deg_s: speed of a turn to a new target. timeout_s: longest wait for a
    response, and for the grasp at `connect`. release: open the hand at `disconnect` instead of holding on.
    """

    control_socket: str = ""
    rings: dict[str, str] = field(default_factory=dict)
    speed_deg_s: float = 15.0
    timeout_s: float = 30.0
    release: bool = False


@TeleoperatorConfig.register_subclass("palpate_keys")
@dataclass(kw_only=True)
class PalpateKeysConfig(TeleoperatorConfig):
    """Keys that turn the object while they are held. limit_deg: largest roll, pitch and yaw."""

    speed_deg_s: float = 10.0
    limit_deg: float = 30.0


@TeleoperatorConfig.register_subclass("palpate_gamepad")
@dataclass(kw_only=True)
class PalpateGamepadConfig(TeleoperatorConfig):
    """A gamepad whose sticks turn the object.

    device: of the kernel's joystick API. axes, signs: number and direction of the axes for roll, pitch and
    yaw; the defaults are those of the driver xpad. back_button: turns back to the start. speed_deg_s: at
    full deflection. limit_deg: largest roll, pitch and yaw. dead_zone: deflection, of 1, that counts as none.
    """

    device: str = "/dev/input/js0"
    axes: list[int] = field(default_factory=lambda: [0, 1, 3])
    signs: list[int] = field(default_factory=lambda: [1, -1, -1])
    back_button: int = 0
    speed_deg_s: float = 10.0
    limit_deg: float = 30.0
    dead_zone: float = 0.1


@TeleoperatorConfig.register_subclass("palpate_turns")
@dataclass(kw_only=True)
class PalpateTurnsConfig(TeleoperatorConfig):
    """A programme of turns, repeated for ever: targets_deg are roll, pitch, yaw of each, reached at
    speed_deg_s and held for pause_s."""

    targets_deg: list[list[float]] = field(default_factory=lambda: [[10.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    speed_deg_s: float = 10.0
    pause_s: float = 1.0
