"""The fingers of a hand in an MJCF or URDF file: each tip with the joints between it and the palm; pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from palpate_edge.common.errors import ConfigError
from palpate_host.control.hand_model import compiled, read_spec

TIP_WORD = "tip"


@dataclass(frozen=True, slots=True)
class ModelJoint:
    """A joint of the model. effort_Nm: the torque limit of the model, infinite without one."""

    name: str
    min_rad: float
    max_rad: float
    effort_Nm: float


@dataclass(frozen=True, slots=True)
class ModelFinger:
    """A finger: its tip (a site, in a URDF a link) and its joints from the palm outwards."""

    tip: str
    joints: tuple[ModelJoint, ...]


@dataclass(frozen=True, slots=True)
class GivenRange:
    """A narrower range for the joints whose name fits a pattern such as ``J1_*``."""

    pattern: str
    min_rad: float
    max_rad: float


def fingers_of_model(
    source: str, tips: Sequence[str] = (), ranges: Sequence[GivenRange] = ()
) -> tuple[ModelFinger, ...]:
    """Return the fingers of an MJCF or URDF file, counter-clockwise seen from +z by the place of their bases.

    The first tip remains the first. tips: sites or links; by default those whose name contains ``tip``, sites
    first. ranges: of joints, in place of the model's.

    Raises ConfigError when the file cannot be read, a tip or a range is missing, or a joint is of no use.
    """
    known = compiled(read_spec(source, ()), source)
    tips = tuple(tips) or _tips_by_name(known)
    if not tips:
        raise ConfigError(
            f"{source} has no site or link with {TIP_WORD!r} in its name: give --tip for each finger"
        )
    model = compiled(read_spec(source, tuple(tips)), source)
    chains = [_chain(model, source, tip) for tip in tips]
    _refuse_shared(source, tips, chains)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bases = np.array([data.xanchor[chain[0]] for chain in chains])
    from_middle = bases - bases.mean(axis=0)
    azimuth_rad = np.arctan2(from_middle[:, 1], from_middle[:, 0])
    order = np.argsort(np.round(azimuth_rad - azimuth_rad[0], 6) % math.tau)
    unused = {one.pattern for one in ranges}
    fingers = []
    for place in order:
        joints = []
        for number in chains[place]:
            joint, pattern = _joint(model, source, number, ranges)
            joints.append(joint)
            unused.discard(pattern)
        fingers.append(ModelFinger(tips[place], tuple(joints)))
    if unused:
        raise ConfigError(
            f"--range {min(unused)}: no joint of a finger in {source} has such a name: correct it"
        )
    return tuple(fingers)


def _tips_by_name(model: mujoco.MjModel) -> tuple[str, ...]:
    sites = [model.site(number).name for number in range(model.nsite)]
    links = [model.body(number).name for number in range(1, model.nbody)]
    for names in (sites, links):
        found = tuple(name for name in names if TIP_WORD in name.lower())
        if found:
            return found
    return ()


def _chain(model: mujoco.MjModel, source: str, tip: str) -> list[int]:
    """Return the numbers of the joints from the world to the tip."""
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, tip)
    if site < 0:
        names = [model.body(number).name for number in range(1, model.nbody)]
        raise ConfigError(
            f"{source} has no site or link {tip!r}; its links: {', '.join(names)}: correct --tip"
        )
    chain: list[int] = []
    body = int(model.site_bodyid[site])
    while body > 0:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        chain = [*range(first, first + count), *chain]
        body = int(model.body_parentid[body])
    if not chain:
        raise ConfigError(f"{source}: no joint moves {tip!r}: give the tip of a finger, --tip")
    for number in chain:
        if model.jnt_type[number] != mujoco.mjtJoint.mjJNT_HINGE:
            name = model.joint(number).name
            raise ConfigError(
                f"{source}: joint {name!r} of {tip} is no hinge: a finger has rotary joints only"
            )
    return chain


def _refuse_shared(source: str, tips: Sequence[str], chains: Sequence[Sequence[int]]) -> None:
    owners: dict[int, str] = {}
    for tip, chain in zip(tips, chains, strict=True):
        for number in chain:
            if number in owners:
                raise ConfigError(
                    f"{source}: one joint moves {owners[number]} and {tip}: give one --tip for each finger,"
                    " and a model without the joints of wrist or arm"
                )
            owners[number] = tip


def _joint(
    model: mujoco.MjModel, source: str, number: int, ranges: Sequence[GivenRange]
) -> tuple[ModelJoint, str]:
    """Return a joint and the pattern of the range that was given for it, empty for none."""
    name = model.joint(number).name
    effort_Nm = float(model.jnt_actfrcrange[number][1]) if model.jnt_actfrclimited[number] else math.inf
    for given in ranges:
        if fnmatchcase(name, given.pattern):
            return ModelJoint(name, given.min_rad, given.max_rad, effort_Nm), given.pattern
    if not model.jnt_limited[number]:
        raise ConfigError(f"{source}: joint {name!r} has no range: give one, --range {name} MIN MAX (rad)")
    low, high = (float(limit) for limit in model.jnt_range[number])
    return ModelJoint(name, low, high, effort_Nm), ""
