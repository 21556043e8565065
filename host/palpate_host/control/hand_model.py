"""The MuJoCo model of a hand: made from hand.toml's [geometry], or read from an MJCF or URDF file."""

from __future__ import annotations

import mujoco

from palpate_edge.common.errors import ConfigError
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_geometry import JointRange, hand_spec


def spec_of(config: HandConfig) -> mujoco.MjSpec:
    """The hand as a specification to add to and to compile; each tip is a site of its name.

    ConfigError as `read_spec` and `hand_spec` say.
    """
    if config.geometry is None:
        return read_spec(config.model.mjcf or "", config.model.tip_sites)
    ranges = [
        [JointRange(joint.name, joint.min_rad, joint.max_rad) for joint in finger.joints]
        for finger in config.fingers
    ]
    return hand_spec(config.geometry, ranges, config.model.tip_sites, config.control.tip_radius_m)


def read_spec(path: str, tip_sites: tuple[str, ...]) -> mujoco.MjSpec:
    """An MJCF, or a URDF, which knows no sites: a tip is then the link of that name, its origin the dome's
    centre, its +z the apex. ConfigError when the file cannot be read.
    """
    try:
        spec = mujoco.MjSpec.from_file(path)
    except ValueError as exc:
        raise _unreadable(path, exc) from exc
    spec.compiler.fusestatic = False  # or a tip link behind a fixed joint would vanish
    spec.compiler.discardvisual = False  # or the geoms and sites of a tip that is only drawn would vanish
    known = {site.name for site in spec.sites}
    for body in spec.bodies:
        if body.name in tip_sites and body.name not in known:
            body.add_site(name=body.name)
    return spec


def compiled(spec: mujoco.MjSpec, source: str) -> mujoco.MjModel:
    """ConfigError, naming `source`, when MuJoCo refuses it."""
    try:
        return spec.compile()
    except ValueError as exc:
        raise _unreadable(source, exc) from exc


def model_of(config: HandConfig) -> mujoco.MjModel:
    """The hand alone, compiled."""
    return compiled(spec_of(config), source_of(config))


def source_of(config: HandConfig) -> str:
    """What to name in a message about the model."""
    return config.model.mjcf or "hand.toml's [geometry]"


def _unreadable(source: str, exc: ValueError) -> ConfigError:
    reason = " ".join(str(exc).split())
    return ConfigError(f"{source}: not a readable MJCF or URDF ({reason}): correct it or set model.mjcf")
