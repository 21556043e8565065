"""The configuration az.toml: the CANopen node of each AZ drive on each RS-485 port."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import Annotated

import msgspec

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.config_file import Strict, read_toml
from palpate_edge.common.errors import ConfigError
from palpate_host.drives.az.axis import AxisSettings, TorqueBy
from palpate_host.drives.az.motor import AzMotor
from palpate_host.drives.az.port import BAUD_RATE, Parity

Text = Annotated[str, msgspec.Meta(min_length=1)]
Positive = Annotated[float, msgspec.Meta(gt=0)]


class ParityName(enum.Enum):
    """The values of `parity` in az.toml."""

    EVEN = "even"
    NONE = "none"
    ODD = "odd"


class AxisConfig(Strict, frozen=True):
    """One axis; the defaults are Table 4's AZM24AK with its 20:1 gear.

    drive_node: the joint's node id in hand.toml. device_id: the drive's Modbus address. torque_limit_Nm:
    enforced by the operating current, independent of the host. B_d_Nms_rad: used with torque_by =
    "admittance". temperature_limit_degC: of drive and motor; an axis above it is in Fault until it has cooled
    by 5 K.
    """

    drive_node: Annotated[int, msgspec.Meta(ge=1, le=127)]
    device_id: Annotated[int, msgspec.Meta(ge=1, le=247)]
    torque_limit_Nm: Positive
    torque_by: TorqueBy = TorqueBy.ADMITTANCE
    B_d_Nms_rad: Positive = 0.4
    steps_per_turn: Annotated[int, msgspec.Meta(ge=200, le=10_000_000)] = 20_000
    torque_Nm: Positive = 1.9
    speed_rad_s: Positive = 2.0
    rate_rad_s2: Positive = 50.0
    temperature_limit_degC: Annotated[float, msgspec.Meta(ge=40.0, le=85.0)] = 75.0

    @property
    def settings(self) -> AxisSettings:
        motor = AzMotor(self.steps_per_turn, self.torque_Nm, self.speed_rad_s, self.rate_rad_s2)
        return AxisSettings(
            self.device_id,
            motor,
            self.torque_limit_Nm,
            self.torque_by,
            self.B_d_Nms_rad,
            self.temperature_limit_degC,
        )


class PortConfig(Strict, frozen=True):
    """One RS-485 adapter and its axes; with one port a finger a round takes less than 20 ms.

    timeout_ms: without communication for this time a drive stops by itself (its alarm 85h).
    """

    path: Text
    axes: Annotated[tuple[AxisConfig, ...], msgspec.Meta(min_length=1)]
    baud_rate: Annotated[int, msgspec.Meta(ge=9_600, le=230_400)] = BAUD_RATE
    parity: ParityName = ParityName.EVEN
    timeout_ms: Annotated[int, msgspec.Meta(ge=50, le=10_000)] = 200

    @property
    def line_parity(self) -> Parity:
        return Parity[self.parity.name]


class AzConfig(Strict, frozen=True):
    """The contents of az.toml; make it with `load`."""

    bus: BusConfig
    ports: Annotated[tuple[PortConfig, ...], msgspec.Meta(min_length=1)]


def load(path: Path) -> AzConfig:
    """Read and check az.toml. Raises ConfigError with the file, the key and how to correct it."""
    config = read_toml(path, AzConfig, guide="models/table4-az.toml in the package shows every key")
    _check_unique(path, "ports.path", [port.path for port in config.ports])
    _check_unique(path, "ports.axes.drive_node", [a.drive_node for port in config.ports for a in port.axes])
    for port in config.ports:
        _check_unique(path, f"device_id on {port.path}", [axis.device_id for axis in port.axes])
    for axis in (axis for port in config.ports for axis in port.axes):
        if axis.torque_limit_Nm > axis.torque_Nm:
            raise ConfigError(
                f"{path}: ports.axes.torque_limit_Nm = {axis.torque_limit_Nm} of drive_node {axis.drive_node}"
                f" exceeds its torque_Nm {axis.torque_Nm}: lower it"
            )
    return config


def _check_unique(path: Path, what: str, values: list[str] | list[int]) -> None:
    for value in values:
        if values.count(value) > 1:  # type: ignore[arg-type]
            raise ConfigError(f"{path}: {what} {value} is used twice: give each entry its own")
