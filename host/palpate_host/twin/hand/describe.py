"""A hand in words and in a picture, so that a hand.toml can be tried before it is used."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import mujoco
import numpy as np

from palpate_edge.errors import ConfigError
from palpate_host import hand_config
from palpate_host.hand_model import compiled, spec_of
from palpate_host.host import load_hand
from palpate_host.rotation import Array
from palpate_host.twin.hand.experiment import make_engine
from palpate_host.twin.hand.rolling import RollingHand
from palpate_host.twin.hand.twin_model import TwinModel, twin_model
from palpate_host.virtual_frame import check_numbering

PICTURE_PX = (480, 640)


def describe(hand_toml: Path) -> str:
    """Joints, tips and first contacts as text. ConfigError, FrameError as loading and grasping say."""
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
    """The hand alone as MJCF."""
    config = hand_config.load(hand_toml)
    spec = spec_of(config)
    compiled(spec, str(hand_toml))
    return str(spec.to_xml())


def draw(hand_toml: Path, path: Path) -> None:
    """Hand and object in the start pose. ConfigError as `film`."""
    twin = twin_model(hand_config.load(hand_toml), with_contacts=False)
    film(twin, [twin.start().qpos], path)


def film(twin: TwinModel, states: Sequence[Array], path: Path) -> None:
    """States of the model (qpos) as pictures side by side. ConfigError when this machine can draw nothing or
    `path` cannot be written."""
    model, data = twin.model, mujoco.MjData(twin.model)
    model.vis.headlight.ambient[:] = 0.5
    camera = mujoco.MjvCamera()
    pictures = []
    try:
        with mujoco.Renderer(model, *PICTURE_PX) as renderer:
            for qpos in states:
                data.qpos[:] = qpos
                mujoco.mj_forward(model, data)
                _aim(camera, data)
                renderer.update_scene(data, camera)
                pictures.append(renderer.render())
    except Exception as exc:  # MuJoCo raises whatever the OpenGL binding does
        raise ConfigError(f"no OpenGL to draw with ({exc}): set MUJOCO_GL=egl or MUJOCO_GL=osmesa") from exc
    row = cv2.cvtColor(np.hstack(pictures), cv2.COLOR_RGB2BGR)
    if not cv2.imwrite(str(path), row):
        raise ConfigError(f"{path}: cannot be written: give another folder or a name that ends in .png")


def _aim(camera: mujoco.MjvCamera, data: mujoco.MjData) -> None:
    """From above and the side, hand and object filling the picture."""
    places = data.xpos[1:]
    camera.lookat = places.mean(axis=0)
    camera.distance, camera.azimuth, camera.elevation = 2.2 * float(np.ptp(places, axis=0).max()), 60.0, -35.0
