"""az.toml: the shipped one loads; a wrong one is refused with file, key and way out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate_edge.common.errors import ConfigError
from palpate_host.config import hand_reader
from palpate_host.config.packaged import MODELS
from palpate_host.drives.az import config as az_config

TEXT = (MODELS / "table4-az.toml").read_text()


def test_the_shipped_file_covers_the_joints_of_table_4() -> None:
    hand = hand_reader.load(MODELS / "table4.toml")
    axes = [axis for port in az_config.load(MODELS / "table4-az.toml").ports for axis in port.axes]
    assert {axis.drive_node for axis in axes} == {joint.drive_node for joint in hand.joints}
    limits = {joint.drive_node: joint.torque_limit_Nm for joint in hand.joints}
    assert all(axis.torque_limit_Nm <= limits[axis.drive_node] for axis in axes)


@pytest.fixture
def load(tmp_path: Path) -> Callable[[str], az_config.AzConfig]:
    def load_text(text: str) -> az_config.AzConfig:
        path = tmp_path / "az.toml"
        path.write_text(text)
        return az_config.load(path)

    return load_text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("device_id = 2", "device_id = 1", "device_id on .* 1 is used twice"),
        ("drive_node = 2,", "drive_node = 1,", "drive_node 1 is used twice"),
        ("by-id/finger-2", "by-id/finger-1", "ports.path .* is used twice"),
        ("torque_limit_Nm = 0.5", "torque_limit_Nm = 5.0", "exceeds its torque_Nm 1.9: lower it"),
        (
            "device_id = 3",
            "device_id = 248",
            "device_id = 248 is out of range: it must be a whole number from 1 to 247",
        ),
        (
            "device_id = 3",
            "device = 3",
            r"unknown key ports\[0\].axes\[2\].device; did you mean .*.device_id\?",
        ),
        (
            "device_id = 3",
            "device_id = 3, temperature_limit_degC = 85.1",
            "temperature_limit_degC = 85.1 is out of range: it must be a number from 40 to 85",
        ),
        (
            "device_id = 3",
            "device_id = 3, temperature_limit_degC = 39.9",
            "temperature_limit_degC = 39.9 is out of range: it must be a number from 40 to 85",
        ),
        (
            "device_id = 3",
            'device_id = 3, temperature_limit_degC = "75"',
            'temperature_limit_degC = "75" is not a number',
        ),
        ("[[ports]]", "[ports]", "az.toml"),
    ],
)
def test_a_wrong_file_is_refused(
    load: Callable[[str], az_config.AzConfig], old: str, new: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        load(TEXT.replace(old, new))


def test_the_limit_of_temperature_is_75_degrees_or_the_axis_own(
    load: Callable[[str], az_config.AzConfig],
) -> None:
    own = TEXT.replace("device_id = 2,", "device_id = 2, temperature_limit_degC = 60.5,")
    axes = [axis.settings for axis in load(own).ports[0].axes]
    assert [axis.temperature_limit_degC for axis in axes] == [75.0, 60.5, 75.0]


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError,
        match=r"nothing\.toml: no such file; models/table4-az\.toml in the package shows every key",
    ):
        az_config.load(tmp_path / "nothing.toml")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200), st.integers(0, len(TEXT)))
def test_any_bytes_are_a_configuration_or_a_config_error(tmp_path: Path, junk: bytes, at: int) -> None:
    path = tmp_path / "az.toml"
    path.write_bytes(TEXT[:at].encode() + junk + TEXT[at:].encode())
    try:
        az_config.load(path)
    except ConfigError as exc:
        assert "\n" not in str(exc).strip() or str(path) in str(exc)
