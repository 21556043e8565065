"""Description and picture of a hand, to check a hand.toml before it is used."""

from __future__ import annotations

from pathlib import Path

from palpate_host.config import hand_reader
from palpate_host.control.hand_model import compiled, spec_of
from palpate_host.control.virtual_frame import check_numbering
from palpate_host.service.host import load_hand
from palpate_twin.hand.film import draw_states, write_row
from palpate_twin.hand.rolling import RollingHand
from palpate_twin.hand.twin_model import twin_model
from palpate_twin.paper.trial import make_engine


def describe(hand_toml: Path) -> str:
    """Return joints, tips and first contacts as text. Raises ConfigError or FrameError for a wrong hand."""
    config, hand = load_hand(hand_toml)
    engine = make_engine(config, "eqs")
    assert isinstance(engine, RollingHand)
    pose = hand.pose(engine.q_rad)
    check_numbering(pose.tip_centre_m)
    lines = [f"{hand_toml}: {len(config.fingers)} fingers, {hand.joint_count} joints"]
    lines += [f"{'joint':16s} drive  range rad       start rad  gravity N m"]
    for joint, q_rad, gravity in zip(config.joints, engine.q_rad, pose.gravity_Nm, strict=True):
        span = f"{joint.min_rad:.2f} to {joint.max_rad:.2f}"
        lines.append(f"{joint.name:16s} 0x{joint.drive_node:02X}   {span:15s} {q_rad:9.3f}  {gravity:11.4f}")
    lines += ["tip              node   centre mm                 into the object mm"]
    gaps = config.control.tip_radius_m - engine.tip_distances_m()
    for finger, centre, depth in zip(config.fingers, pose.tip_centre_m, gaps, strict=True):
        x, y, z = 1e3 * centre
        place = f"{x:7.1f} {y:7.1f} {z:7.1f}"
        lines.append(f"{finger.name:16s} 0x{finger.fingertip_node:02X}   {place:25s} {1e3 * depth:6.2f}")
    return "\n".join(lines)


def mjcf(hand_toml: Path) -> str:
    """Return the hand without the object as MJCF."""
    config = hand_reader.load(hand_toml)
    spec = spec_of(config)
    compiled(spec, str(hand_toml))
    return str(spec.to_xml())


def draw(hand_toml: Path, path: Path) -> None:
    """Draw hand and object in the start pose. Raises ConfigError as `draw_states` and `write_row`."""
    twin = twin_model(hand_reader.load(hand_toml), with_contacts=False)
    write_row(path, draw_states(twin, [twin.start().qpos]))
