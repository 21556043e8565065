"""The MuJoCo model of a hand, from [geometry] of hand.toml or from an MJCF or URDF file."""

from __future__ import annotations

import mujoco

from palpate_edge.common.errors import ConfigError
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_geometry import JointRange, hand_spec


def spec_of(config: HandConfig) -> mujoco.MjSpec:
    """Return the hand as a specification that can be extended and compiled; each tip is a site of its name.

    Raises ConfigError as `read_spec` and `hand_spec` do.
    """
    if config.geometry is None:
        return read_spec(config.model.mjcf or "", config.model.tip_sites)
    ranges = [
        [JointRange(joint.name, joint.min_rad, joint.max_rad) for joint in finger.joints]
        for finger in config.fingers
    ]
    return hand_spec(config.geometry, ranges, config.model.tip_sites, config.control.tip_radius_m)


def read_spec(path: str, tip_sites: tuple[str, ...]) -> mujoco.MjSpec:
    """Read an MJCF or URDF file.

    A URDF has no sites: there a tip is the link of that name, its origin the dome's centre, its +z the apex.
    Raises ConfigError when the file cannot be read.
    """
    try:
        spec = mujoco.MjSpec.from_file(path)
    except ValueError as exc:
        raise _unreadable(path, exc) from exc
    spec.compiler.fusestatic = False  # keeps a tip link behind a fixed joint
    spec.compiler.discardvisual = False  # keeps the geoms and sites of a tip that is only drawn
    known = {site.name for site in spec.sites}
    for body in spec.bodies:
        if body.name in tip_sites and body.name not in known:
            body.add_site(name=body.name)
    return spec


def compiled(spec: mujoco.MjSpec, source: str) -> mujoco.MjModel:
    """Compile a specification. Raises ConfigError with `source` when MuJoCo rejects it."""
    try:
        return spec.compile()
    except ValueError as exc:
        raise _unreadable(source, exc) from exc


def model_of(config: HandConfig) -> mujoco.MjModel:
    """Return the compiled model of the hand alone."""
    return compiled(spec_of(config), source_of(config))


def source_of(config: HandConfig) -> str:
    """Return the model's source for messages."""
    return config.model.mjcf or "hand.toml's [geometry]"


def _unreadable(source: str, exc: ValueError) -> ConfigError:
    reason = " ".join(str(exc).split())
    return ConfigError(f"{source}: not a readable MJCF or URDF ({reason}): correct it or set model.mjcf")
