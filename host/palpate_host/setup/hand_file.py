"""The configuration of a hand from a template, found nodes and a model, and its text; pure."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.errors import ConfigError
from palpate_host.config.hand_config import FingerConfig, HandConfig, JointConfig, ModelConfig, StartMode
from palpate_host.setup.found_nodes import DrivePlace
from palpate_host.setup.model_fingers import ModelFinger

HEADING = "# Written by palpate-host setup. Every key: palpate-host docs configuration\n"
TORQUE_STEPS = 1000  # of a N m


def with_model(template: HandConfig, mjcf: str, fingers: Sequence[ModelFinger]) -> HandConfig:
    """Return the template with the fingers of a model file; gains and damping stay the template's.

    A joint's torque limit is the smaller one of model and template. Node ids count from 1 and 16.
    """
    usual = template.joints[0]
    first_of = [sum(len(finger.joints) for finger in fingers[:place]) for place in range(len(fingers))]
    made = tuple(
        FingerConfig(
            name=f"finger-{place}",
            fingertip_node=0x10 + place - 1,
            joints=tuple(
                JointConfig(
                    name=joint.name,
                    drive_node=first + number,
                    direction=1,
                    zero_offset_rad=0.0,
                    min_rad=joint.min_rad,
                    max_rad=joint.max_rad,
                    B_Nms_rad=usual.B_Nms_rad,
                    torque_limit_Nm=min(usual.torque_limit_Nm, joint.effort_Nm),
                )
                for number, joint in enumerate(finger.joints, start=1)
            ),
        )
        for place, (first, finger) in enumerate(zip(first_of, fingers, strict=True), start=1)
    )
    model = ModelConfig(mjcf=mjcf, tip_sites=tuple(finger.tip for finger in fingers))
    return msgspec.structs.replace(template, model=model, fingers=made, geometry=None, twin=None)


def with_nodes(
    config: HandConfig,
    bus: BusConfig,
    fingertips: Sequence[int],
    drives: Sequence[DrivePlace],
    directions: Mapping[DrivePlace, int],
) -> HandConfig:
    """Return the hand with these nodes, which waits for commands when it starts.

    fingertips: node ids finger by finger. drives: joint by joint. directions: drive -> 1 or -1; the
    others keep that of their joint. Raises ConfigError when there are not as many nodes as fingers or joints.
    """
    _refuse_count("fingertips", len(fingertips), f"{len(config.fingers)} fingers", len(config.fingers))
    _refuse_count("drives", len(drives), f"{len(config.joints)} joints", len(config.joints))
    remaining = iter(drives)
    fingers = []
    for finger, tip in zip(config.fingers, fingertips, strict=True):
        joints = []
        for joint in finger.joints:
            place = next(remaining)
            changed = {"drive_node": place.node_id, "axis": place.axis}
            changed["direction"] = directions.get(place, joint.direction)
            joints.append(msgspec.structs.replace(joint, **changed))
        fingers.append(
            msgspec.structs.replace(
                finger,
                fingertip_node=tip,
                joints=tuple(joints),
                calibration=None,
                serial=None,
                software=None,
            )
        )
    return msgspec.structs.replace(config.starting(StartMode.COMMAND), bus=bus, fingers=tuple(fingers))


def with_torque_limits(config: HandConfig, caps_Nm: Mapping[DrivePlace, float]) -> HandConfig:
    """Return the hand with no joint's torque limit above that of its drive. caps_Nm: drive -> limit."""
    fingers = tuple(
        msgspec.structs.replace(finger, joints=tuple(_limited(joint, caps_Nm) for joint in finger.joints))
        for finger in config.fingers
    )
    return msgspec.structs.replace(config, fingers=fingers)


def hand_toml(config: HandConfig) -> str:
    """Return the text of a hand.toml with every key that has a value."""
    return HEADING + "".join(_lines(msgspec.to_builtins(config), ""))


def _limited(joint: JointConfig, caps_Nm: Mapping[DrivePlace, float]) -> JointConfig:
    place = DrivePlace(joint.drive_node, joint.axis)
    cap_Nm = math.floor(caps_Nm.get(place, 0.0) * TORQUE_STEPS) / TORQUE_STEPS
    if not 0 < cap_Nm < joint.torque_limit_Nm:
        return joint
    return msgspec.structs.replace(joint, torque_limit_Nm=cap_Nm)


def _refuse_count(what: str, found: int, of: str, count: int) -> None:
    if found != count:
        raise ConfigError(
            f"{found} {what} for {of}: connect the others (palpate-host bus scan), select with"
            f" --{what[:-1]} NODE, or give another --template or --model"
        )


def _lines(table: Mapping[str, Any], prefix: str) -> Iterator[str]:
    """Yield the lines of a table: its values first, then its tables, then its lists of tables."""
    kept = {key: value for key, value in table.items() if value is not None}
    tables = {key: value for key, value in kept.items() if isinstance(value, dict)}
    lists = {key: value for key, value in kept.items() if _is_list_of_tables(value)}
    for key, value in kept.items():
        if key not in tables and key not in lists:
            yield f"{key} = {_value(value)}\n"
    for key, value in tables.items():
        yield f"\n[{prefix}{key}]\n"
        yield from _lines(value, f"{prefix}{key}.")
    for key, entries in lists.items():
        for entry in entries:
            yield f"\n[[{prefix}{key}]]\n"
            yield from _lines(entry, f"{prefix}{key}.")


def _is_list_of_tables(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and bool(value) and isinstance(value[0], dict)


def _value(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(_value(one) for one in value)}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # a TOML basic string has the escapes of JSON
    return str(value).lower()  # true, false, inf
