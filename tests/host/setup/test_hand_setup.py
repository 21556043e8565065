"""``palpate-host setup`` on a hub with real slave cores: what is found, asked, refused and written."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate_bus.eds.cia402 import DriveState
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError, ConfigError
from palpate_host.config import hand_reader
from palpate_host.service.host import load_hand

STRANGER = Path(__file__).parents[1] / "stranger" / "hand.xml"


def test_a_hand_is_set_up_without_questions(hand_on_hub, table_4, tmp_path: Path) -> None:
    """The file gives the same hand as its template; nothing moves, and no drive is enabled."""
    before = {node: drive.plant.position_rad for node, drive in hand_on_hub.drives.items()}
    done = hand_on_hub.run("--yes")
    assert done.exit_code == 0, done.output
    assert "fingertip 0x10  palpate fingertip, 1018h 0/" in done.output
    assert done.output.count("drive     0x") == 9 and done.output.count(" ok\n") == 12
    assert "finger-2: tip at 120 deg, fingertip 0x11; joint drive (rad): abduction_2 4 (+0.00)" in done.output
    config, _ = load_hand(tmp_path / "hand.toml")
    assert config.fingers == table_4[0].fingers and config.geometry == table_4[0].geometry
    assert config.bus.channel == str(hand_on_hub.channel)
    assert {drive.state for drive in hand_on_hub.drives.values()} == {DriveState.SWITCH_ON_DISABLED}
    for node, drive in hand_on_hub.drives.items():
        assert drive.plant.position_rad == pytest.approx(before[node], abs=1e-6)
    assert (tmp_path / "hand.svg").read_text().count("<path") > 30
    with pytest.raises(ConfigError, match=r"hand\.toml exists: give another -o"):
        hand_on_hub.run("--yes")


def test_the_data_bit_rate_of_the_fingertips_is_written(hand_on_fd_hub, tmp_path: Path) -> None:
    done = hand_on_fd_hub.run("--yes")
    assert done.exit_code == 0, done.output
    assert done.output.count(" ok\n") == 12
    assert load_hand(tmp_path / "hand.toml")[0].bus.data_bitrate == 5_000_000


def test_fingertips_flash_and_joints_are_turned_by_hand(
    hand_on_hub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The person finds 0x11 on the first finger, and the drives 2 and 1 exchanged, 2 mounted in reverse."""
    monkeypatch.setattr("palpate_host.setup.node_requests.HALF_PERIOD_S", 0.05)
    hub = hand_on_hub

    def person() -> Iterator[str]:
        yield "y"
        yield "0"  # flash it again
        yield "2"
        yield "1"
        yield "1"  # taken
        yield "3"
        yield "y"
        yield ""  # nothing was turned
        for node, turn_rad in ((2, -0.2), (1, 0.1), *((node, 0.2) for node in range(3, 10))):
            hub.hold(node, turn_rad)
            yield ""
        yield "y"

    done = hub.run(answers=person())
    assert (
        "finger 1 has 0x11" in done.output and "no drive that is left has turned by 0.05 rad" in done.output
    )
    assert "node 0x12 aborts flashing its light (2030h)" in done.output
    assert done.exit_code == 0, done.output
    flashes = [(0x10, 0), (0x10, 255)] * 8 + [(0x11, 0), (0x11, 255)] * 4
    assert hub.led_levels == flashes
    fingers = hand_reader.load(tmp_path / "hand.toml").fingers
    assert [finger.fingertip_node for finger in fingers] == [0x11, 0x10, 0x12]
    assert [(joint.drive_node, joint.direction) for joint in fingers[0].joints] == [(2, -1), (1, 1), (3, 1)]


def places(path: Path) -> list[list[tuple[int, int | None, int]]]:
    """Return node, axis and direction of the joints of each finger."""
    fingers = hand_reader.load(path).fingers
    return [[(one.drive_node, one.axis, one.direction) for one in finger.joints] for finger in fingers]


def test_axes_of_a_node_are_found(axes_on_fd_hub, tmp_path: Path) -> None:
    """The torque limit of an axis lowers that of its joint."""
    axes_on_fd_hub.drives[2].slave.write(0x6072 + 0x800, 0, 200)  # thousandths of 1.9 N m
    done = axes_on_fd_hub.run("--yes")
    assert done.exit_code == 0, done.output
    assert done.output.count(" ok\n") == 12
    assert places(tmp_path / "hand.toml") == [[(node, axis, 1) for axis in range(3)] for node in (1, 2, 3)]
    limits = [joint.torque_limit_Nm for joint in hand_reader.load(tmp_path / "hand.toml").joints]
    assert limits[4] == pytest.approx(0.38, abs=0.005) and set(limits[:4] + limits[5:]) == {0.5}


def test_axes_are_turned_by_hand(axes_on_fd_hub, tmp_path: Path) -> None:
    """The person finds the first finger's axes in another order, one of them in reverse."""
    found = [(1, 2, 1), (1, 0, -1), (1, 1, 1), *((node, axis, 1) for node in (3, 2) for axis in range(3))]

    def person() -> Iterator[str]:
        yield "n"
        yield "y"
        for node, axis, direction in found:
            axes_on_fd_hub.hold(node, 0.2 * direction, axis)
            yield ""
        yield "y"

    done = axes_on_fd_hub.run(answers=person())
    assert done.exit_code == 0, done.output
    assert "abduction_1: drive 1:2, direction 1" in done.output
    assert places(tmp_path / "hand.toml") == [found[:3], found[3:6], found[6:]]


def test_drives_are_given_as_node_and_axis(axes_on_fd_hub, tmp_path: Path) -> None:
    given = [(3, 1), (3, 0), (3, 2), *((node, axis) for node in (1, 2) for axis in range(3))]
    options = [word for node, axis in given for word in ("--drive", f"0x{node:02X}:{axis}")]
    done = axes_on_fd_hub.run("--yes", *options)
    assert done.exit_code == 0, done.output
    assert places(tmp_path / "hand.toml")[0] == [(3, 1, 1), (3, 0, 1), (3, 2, 1)]
    assert axes_on_fd_hub.run("--yes", "--drive", "1:8").exit_code == 2


def test_a_model_with_more_joints_than_drives_is_refused(hand_on_hub, tmp_path: Path) -> None:
    (tmp_path / "hand.xml").write_bytes(STRANGER.read_bytes())
    with pytest.raises(ConfigError, match="9 drives for 12 joints: connect the others"):
        hand_on_hub.run("--yes", "--model", "hand.xml")
    assert not (tmp_path / "hand.toml").exists()


def test_nodes_with_problems_are_written_only_when_a_person_confirms(hand_on_hub, tmp_path: Path) -> None:
    """A drive without a deadline is a problem; a weak one lowers the torque limit of its joint."""
    hand_on_hub.drives[5].slave.write(0x1400, 5, 0)
    hand_on_hub.drives[3].slave.write(0x6072, 0, 200)  # thousandths of 1.9 N m
    done = hand_on_hub.run("--yes")
    assert done.exit_code == 1 and "not written, as 1 of 12 nodes have problems" in done.output
    assert not (tmp_path / "hand.toml").exists()
    done = hand_on_hub.run(answers=iter(["n", "n", "y"]))
    assert (
        "has no deadline for RPDO 1" in done.output and "nodes have problems: write hand.toml?" in done.output
    )
    assert done.exit_code == 0
    limits = [joint.torque_limit_Nm for joint in hand_reader.load(tmp_path / "hand.toml").joints]
    assert limits[2] == pytest.approx(0.38, abs=0.005) and set(limits[:2] + limits[3:]) == {0.5}


def test_a_bus_in_use_is_refused(hand_on_hub, tmp_path: Path) -> None:
    with open_bus(BusConfig(interface="palpate", channel=str(hand_on_hub.channel)), "other") as bus:
        for word in (0x06, 0x07, 0x0F):
            request = CanFrame(0x601, bytes((0x2B, 0x40, 0x60, 0, word, 0, 0, 0)))
            bus.send([request])
            while 0x581 not in [frame.can_id for _, frame in bus.receive(1.0)]:
                pass
    with pytest.raises(BusError, match="drive 0x01 is enabled, another master commands it"):
        hand_on_hub.run("--yes")
    assert list(tmp_path.glob("hand.*")) == []
