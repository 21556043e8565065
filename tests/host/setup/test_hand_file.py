"""The text of a hand.toml, and the fingers of MJCF and URDF files."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.errors import ConfigError
from palpate_host.config import hand_config, hand_reader
from palpate_host.config.packaged import MODELS
from palpate_host.service.host import hand_of
from palpate_host.service.host_core import HostCore
from palpate_host.setup.found_nodes import DrivePlace
from palpate_host.setup.hand_file import hand_toml, with_model, with_nodes
from palpate_host.setup.model_fingers import GivenRange, fingers_of_model

STRANGER = Path(__file__).parents[1] / "stranger"
HOLDING = (
    GivenRange("J0_?", -0.6, 0.6),
    GivenRange("J1_?", -1.39, -0.1),
    GivenRange("J2_?", 0.05, 0.8),
    GivenRange("J3_?", 0.0, 1.48),
)
"""Ranges of stranger/hand.toml."""


@pytest.mark.parametrize("path", [*sorted(MODELS.glob("table*[34e].toml")), STRANGER / "hand.toml"], ids=str)
def test_a_written_hand_is_the_hand(path: Path) -> None:
    config = hand_reader.load(path)
    assert hand_reader.parse(path.with_name("written.toml"), hand_toml(config)) == config


def test_the_fingers_of_a_model_are_those_of_its_own_hand_toml() -> None:
    """stranger/hand.toml was written by hand."""
    own = hand_reader.load(STRANGER / "hand.toml")
    template = hand_reader.load(MODELS / "table4.toml")
    made = with_model(template, "hand.xml", fingers_of_model(str(STRANGER / "hand.xml"), (), HOLDING))
    assert made.model.tip_sites == own.model.tip_sites
    kept = ("name", "drive_node", "direction", "min_rad", "max_rad")
    assert [[getattr(joint, key) for key in kept] for joint in made.joints] == [
        [getattr(joint, key) for key in kept] for joint in own.joints
    ]
    config = hand_reader.parse(STRANGER / "written.toml", hand_toml(made))
    HostCore(config, hand_of(config))


def test_without_narrower_ranges_crossed_fingers_are_refused() -> None:
    template = hand_reader.load(MODELS / "table4.toml")
    made = with_model(template, str(STRANGER / "hand.xml"), fingers_of_model(str(STRANGER / "hand.xml")))
    with pytest.raises(ConfigError, match="numbered clockwise"):
        HostCore(made, hand_of(made))


AXES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def urdf(**limits: str) -> str:
    """A palm with three fingers of one joint at 0, 120 and 240 degrees, written clockwise."""
    parts = ['<robot name="hand"><link name="palm"/>']
    for name, x, y in (("a", 0.1, 0.0), ("b", -0.05, -0.0866), ("c", -0.05, 0.0866)):
        inertia = " ".join(f'{axes}="{1e-4 * (axes[1] == axes[2])}"' for axes in AXES)
        inertial = f'<inertial><mass value="0.1"/><inertia {inertia}/></inertial>'
        limit = limits.get(name, '<limit lower="-0.1" upper="1.2" effort="0.2" velocity="2"/>')
        parts += [
            f'<link name="rod_{name}">{inertial}</link><link name="{name}_tip">{inertial}</link>',
            f'<joint name="bend_{name}" type="{"revolute" if limit else "continuous"}"><parent link="palm"/>',
            f'<child link="rod_{name}"/><origin xyz="{x} {y} 0"/><axis xyz="0 1 0"/>{limit}</joint>',
            f'<joint name="end_{name}" type="fixed"><parent link="rod_{name}"/><child link="{name}_tip"/>',
            '<origin xyz="0 0 0.1"/></joint>',
        ]
    return "".join([*parts, "</robot>"])


def test_fingers_of_a_urdf_run_counter_clockwise_with_range_and_effort(tmp_path: Path) -> None:
    (tmp_path / "hand.urdf").write_text(urdf())
    fingers = fingers_of_model(str(tmp_path / "hand.urdf"))
    assert [finger.tip for finger in fingers] == ["a_tip", "c_tip", "b_tip"]
    (joint,) = fingers[1].joints
    assert (joint.name, joint.min_rad, joint.max_rad, joint.effort_Nm) == ("bend_c", -0.1, 1.2, 0.2)
    made = with_model(hand_reader.load(MODELS / "table4.toml"), str(tmp_path / "hand.urdf"), fingers)
    assert {joint.torque_limit_Nm for joint in made.joints} == {0.2}


@pytest.mark.parametrize(
    ("tips", "ranges", "limits", "said"),
    [
        ((), (), {"b": ""}, "joint 'bend_b' has no range: give one, --range bend_b MIN MAX"),
        (("a_tip", "rod_x"), (), {}, "has no site or link 'rod_x'; its links: palm, "),
        (("palm",), (), {}, "no joint moves 'palm'"),
        (("a_tip", "rod_a", "b_tip"), (), {}, "one joint moves a_tip and rod_a: give one --tip for each"),
        ((), (GivenRange("J?", 0.0, 1.0),), {}, "--range J?: no joint of a finger"),
    ],
)
def test_a_model_that_is_no_hand_is_refused(
    tmp_path: Path, tips: tuple[str, ...], ranges: tuple[GivenRange, ...], limits: dict[str, str], said: str
) -> None:
    (tmp_path / "hand.urdf").write_text(urdf(**limits))
    with pytest.raises(ConfigError) as refusal:
        fingers_of_model(str(tmp_path / "hand.urdf"), tips, ranges)
    assert said in str(refusal.value)


def test_a_hand_waits_for_commands_whatever_its_template_does() -> None:
    stranger = hand_reader.load(STRANGER / "hand.toml")
    assert stranger.run.start is hand_config.StartMode.AUTO
    drives = [joint.drive_node for joint in stranger.joints]
    made = with_nodes(
        stranger,
        BusConfig(interface="palpate"),
        [0x20, 0x21, 0x22],
        [DrivePlace(node) for node in drives],
        {},
    )
    assert made.run.start is hand_config.StartMode.COMMAND
