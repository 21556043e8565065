"""The parts of the LeRobot plug-in that need no LeRobot, against palpate's own border."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.integrations.conftest import Serving

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_host.common import rotation
from palpate_host.common.command import Rotate
from palpate_host.common.status import HostStatus
from palpate_host.operator.server import default_control_socket


def test_a_turn_reaches_the_host_and_its_status_comes_back(plugin, tmp_path: Path, status) -> None:
    connection = plugin("control_socket").HostConnection
    with (
        closing(Serving(tmp_path / "s", status)) as host,
        closing(connection(tmp_path / "s", 10.0)) as client,
    ):
        answer = client.ask("rotate", rpy_deg=[1.0, -2.0, 3.5], ramp_s=0.25)
        assert host.commands == [Rotate((1.0, -2.0, 3.5), 0.25)]
        assert answer == msgspec.json.decode(msgspec.json.encode(status))
        assert client.ask("status") == answer


def test_a_refused_command_is_an_error_with_the_hosts_reason(plugin, tmp_path: Path, status) -> None:
    module = plugin("control_socket")
    reason = "rotate is refused in mode ready (waits): grasp first"
    with (
        closing(Serving(tmp_path / "s", status, reason)),
        closing(module.HostConnection(tmp_path / "s", 10.0)) as client,
    ):
        with pytest.raises(module.PalpateHandError, match="grasp first") as raised:
            client.ask("rotate", rpy_deg=[1.0, 0.0, 0.0])
        assert str(raised.value) == reason
        with pytest.raises(module.PalpateHandError, match="not a request"):
            client.ask("rotate", rpy_deg=[200.0, 0.0, 0.0])


def test_no_host_and_a_host_that_ends_are_errors_with_the_next_step(plugin, tmp_path: Path, status) -> None:
    module = plugin("control_socket")
    with pytest.raises(
        module.PalpateHandError, match=r"palpate-host run --config hand\.toml --start command"
    ):
        module.HostConnection(tmp_path / "s", 10.0)
    host = Serving(tmp_path / "s", status)
    with closing(module.HostConnection(tmp_path / "s", 10.0)) as client:
        client.ask("status")
        host.close()
        with pytest.raises(module.PalpateHandError, match=r"closed the connection|has ended"):
            client.ask("status")


def test_the_stream_gives_the_newest_tick_and_after_a_turn_one_with_its_effect(
    plugin, tmp_path: Path, status
) -> None:
    """`turned` counts the turns that were executed before the tick, as the host's R_d does."""
    module = plugin("control_socket")

    def tick(last: HostStatus, commands: int) -> HostStatus:
        return replace(last, time_us=last.time_us + 1, turned=float(commands))

    host = Serving(tmp_path / "s", replace(status, turned=0.0), tick=tick)
    with (
        closing(host),
        closing(plugin("status_reader").StatusReader(tmp_path / "s", 10.0)) as stream,
        closing(module.HostConnection(tmp_path / "s", 10.0)) as client,
    ):
        for number in range(1, 21):
            response = client.ask("rotate", rpy_deg=[1.0, 0.0, 0.0], ramp_s=0.0)
            stream.pass_by(response)
            assert stream.newest()["turned"] == number
        seen = client.ask("status")["time_us"]
        time.sleep(0.1)
        assert stream.newest()["time_us"] > seen, "what was sent during the pause is not read again"
        host.close()
        with pytest.raises(module.PalpateHandError, match=r"closed the connection|has ended"):
            while stream.newest():
                time.sleep(0.01)


@pytest.mark.parametrize("variable", ["PALPATE_CONTROL", "XDG_RUNTIME_DIR", None])
def test_the_default_socket_is_the_hosts(plugin, monkeypatch, tmp_path: Path, variable: str | None) -> None:
    for name in ("PALPATE_CONTROL", "RUNTIME_DIRECTORY", "XDG_RUNTIME_DIR"):
        monkeypatch.delenv(name, raising=False)
    if variable:
        monkeypatch.setenv(variable, str(tmp_path))
    assert plugin("control_socket").default_control_socket() == default_control_socket()


def test_rotations_are_the_hosts(plugin) -> None:
    module = plugin("rotations")
    random = np.random.default_rng(3)
    for rpy in random.uniform((-180.0, -89.0, -180.0), (180.0, 89.0, 180.0), (200, 3)):
        R = rotation.from_rpy_deg(*rpy)
        assert module.from_rpy_deg(*rpy) == pytest.approx(R, abs=1e-12)
        assert module.to_rpy_deg(R) == pytest.approx(rpy, abs=1e-9)
        assert module.angle_deg(R) == pytest.approx(rotation.angle_deg(R), abs=1e-6)
    for pitch_deg in (90.0, -90.0):  # where roll and yaw turn about one axis
        R = rotation.from_rpy_deg(20.0, pitch_deg, -40.0)
        assert module.to_rpy_deg(R) == pytest.approx(rotation.to_rpy_deg(R), abs=1e-9)
        assert module.from_rpy_deg(*module.to_rpy_deg(R)) == pytest.approx(R, abs=1e-9)
    assert module.angle_deg(rotation.from_rpy_deg(0.001, 0.0, 0.0)) == pytest.approx(0.001, rel=1e-6)


def test_observations_are_the_status_and_absent_values_are_zero(plugin, status: HostStatus) -> None:
    module = plugin("observations")
    state = msgspec.json.decode(msgspec.json.encode(status))
    joints, contacts = module.joint_values(state), module.contact_values(state)
    for joint in status.joints:
        assert joints[f"{joint.name}.pos_rad"] == joint.position_rad
        assert joints[f"{joint.name}.torque_Nm"] == joint.torque_Nm
    for finger in status.fingers:
        assert finger.position_mm is not None and finger.normal_force_N
        assert [contacts[f"{finger.name}.{axis}_mm"] for axis in "xyz"] == list(finger.position_mm)
        assert contacts[f"{finger.name}.fn_N"] == finger.normal_force_N
        assert contacts[f"{finger.name}.radius95_mm"] == (finger.radius95_mm or 0.0)
        assert contacts[f"{finger.name}.in_contact"] == 1.0
    state["fingers"][0] |= {"in_contact": False}
    state["joints"][0]["position_rad"] = None
    gone = module.contact_values(state)
    assert gone.keys() == contacts.keys()
    name = status.fingers[0].name
    assert {value for key, value in gone.items() if key.startswith(f"{name}.")} == {0.0}
    with pytest.raises(plugin("control_socket").PalpateHandError, match="position_rad is not known"):
        module.joint_values(state)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_ring_is_read_as_its_writer_wrote_it(plugin, tmp_path: Path, channels: int) -> None:
    """Red, green, blue for LeRobot; the ring has OpenCV's order."""
    module = plugin("picture_ring")
    random = np.random.default_rng(channels)
    form = RingFormat(width=31, height=17, channels=channels)
    with closing(RingWriter(tmp_path / "ring", form)) as writer:
        ring = module.PictureRing(tmp_path / "ring")
        assert ring.shape == (17, 31, 3)
        with pytest.raises(module.PalpateHandError, match="no complete frame"):
            ring.newest()
        for number in range(6):
            image = random.integers(0, 256, form.shape, dtype=np.uint8)
            writer.write(image, number, 1000 * number)
            found = ring.newest()
            expected = image[..., ::-1] if channels == 3 else np.stack([image] * 3, axis=2)
            assert np.array_equal(found, expected)


def test_a_file_that_is_no_ring_is_refused(plugin, tmp_path: Path) -> None:
    module = plugin("picture_ring")
    (tmp_path / "other").write_bytes(bytes(4096))
    (tmp_path / "empty").touch()
    for name in ("none", "other", "empty"):
        with pytest.raises(module.PalpateHandError, match=f"{name}: no ring of frames"):
            module.PictureRing(tmp_path / name)
