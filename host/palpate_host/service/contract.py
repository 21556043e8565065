"""The contract of a bus log: what its frames mean, as header entries, and the check against a hand.

| key | value |
|---|---|
| eds.fingertip.meaning, eds.cia402.meaning | digest of the parsed EDS; comments and layout of the file do not
count; eds.cia402-axes.meaning of a hand with drive nodes of several axes |
| hand.digest, hand.KEY | digest of hand.toml's effective values, defaults included, and the values as JSON |
| model.digest | digest of the compiled model: bodies, joints, tips, masses |
| node.0xNN | the device at each node id |
| bus.data_bitrate | on a CAN FD bus: contacts are TPDO 10; missing on a classic bus |
| host.build | version and digest of palpate's sources; not compared |

Else [bus], [run] and [twin] of hand.toml do not count: where the bus is, who starts the hand, the simulation.
`fingers[].calibration` is one of the values, so a log is bound to the calibrations that hand.toml names.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

import palpate_host
from palpate_bus.decode.device import AXES_KIND, axes_text
from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.eds.cia402_axes import CIA402_AXES_EDS
from palpate_bus.logs.candump import LogHeader
from palpate_edge import __version__
from palpate_edge.common.errors import ConfigError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.eds_history import EARLIER
from palpate_edge.node.object_dictionary import ObjectDictionary
from palpate_edge.node.parsed_eds import FINGERTIP_EDS, checksum_of
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_model import model_of

EDS_FILES = {"eds.fingertip": FINGERTIP_EDS, "eds.cia402": CIA402_EDS}
"""Keys of the hashes of bytes in logs of format 1; with MEANING, of the digests of meaning."""
AXES_EDS_FILES = {"eds.cia402-axes": CIA402_AXES_EDS}
"""Further keys of a hand with drive nodes of several axes."""
MEANING = ".meaning"
EARLIER_MEANINGS = frozenset(eds.meaning for eds in EARLIER)
HAND, DIGEST, MODEL, BUILD = "hand.", "hand.digest", "model.digest", "host.build"
DATA_BITRATE = "bus.data_bitrate"
LEFT_OUT = ("bus", "run", "twin")
DIGITS = 16
LONGEST_VALUE = 300
"""Largest value of a line; a longer table has a line for each of its keys."""
DECIMALS = 9
"""The digest rounds the model's numbers (m, kg, rad) to so many digits: processors round differently."""
SHOWN = 3

Values = dict[str, Any]


def contract_header(config: HandConfig) -> LogHeader:
    """Return the header that binds a log to this hand."""
    values = effective_values(config)
    entries = {DIGEST: _digest(flat(values)), MODEL: model_digest(config)}
    entries |= {HAND + key: value for key, value in _lines(values)}
    return LogHeader({**frames_header(config).entries, **entries})


def frames_header(config: HandConfig) -> LogHeader:
    """Return the header that gives the frames of this hand their meaning: the EDS files and the nodes."""
    files = EDS_FILES | (AXES_EDS_FILES if config.node_axes else {})
    meanings = {key + MEANING: eds_digest(path) for key, path in files.items()}
    rate = config.bus.data_bitrate
    fd = {} if rate is None else {DATA_BITRATE: str(rate)}
    return LogHeader(meanings | fd | _nodes(config))


def recording_header(config: HandConfig) -> LogHeader:
    """Return the header of a recording of this hand: the contract, and the build that makes it."""
    return LogHeader({**contract_header(config).entries, BUILD: build()})


def _nodes(config: HandConfig) -> dict[str, str]:
    nodes = {joint.drive_node: f"drive:{joint.name}" for joint in config.joints}
    nodes |= {node: f"{AXES_KIND}:{axes_text(names)}" for node, names in config.axis_names.items()}
    nodes |= {finger.fingertip_node: f"fingertip:{finger.name}" for finger in config.fingers}
    return {f"node.0x{node:02X}": who for node, who in sorted(nodes.items())}


def eds_digest(path: Path) -> str:
    """Return the digest of an EDS's objects: types, access, limits, defaults, names. Raises ConfigError."""
    return meaning_of(load_eds(path, 1))


def meaning_of(od: ObjectDictionary) -> str:
    """Return the digest of the objects of node 1."""
    objects = [msgspec.to_builtins(entry) for _, entry in sorted(od.entries.items())]
    return _digest({"objects": objects, "bit rates": sorted(od.bit_rates_kbit_s)})


def effective_values(config: HandConfig) -> Values:
    """Return hand.toml's values with all defaults, without LEFT_OUT and without the path of model.mjcf.

    A joint that is no axis of a node with several has no `axis`, and a fingertip with the software of the EDS
    has no `software`, as in logs from before these keys.
    """
    values: Values = json.loads(msgspec.json.encode(config))
    for key in LEFT_OUT:
        values.pop(key, None)
    for finger in values["fingers"]:
        if finger["software"] is None:
            del finger["software"]
    for joint in (joint for finger in values["fingers"] for joint in finger["joints"]):
        if joint["axis"] is None:
            del joint["axis"]
    values["model"] = {"tip_sites": values["model"]["tip_sites"]}
    return values


def model_digest(config: HandConfig) -> str:
    """Return the digest of the compiled model's kinematics and masses. Raises ConfigError."""
    model = model_of(config)
    names = [model.joint(joint).name for joint in range(model.njnt)]
    names += [model.site(site).name for site in range(model.nsite)]
    numbers = (
        *(model.body_parentid, model.body_pos, model.body_quat, model.body_mass, model.body_ipos),
        *(model.jnt_type, model.jnt_bodyid, model.jnt_pos, model.jnt_axis),
        *(model.site_bodyid, model.site_pos, model.site_quat, model.opt.gravity),
    )
    texts = [np.array2string(np.round(part, DECIMALS) + 0.0, threshold=1 << 20) for part in numbers]
    return _digest([names, texts])


@cache
def build() -> str:
    """Return palpate's version with the digest of the sources of the host and of what it uses."""
    digest = hashlib.sha256()
    packages = Path(palpate_host.__file__).parent.parent
    edge = Path(FINGERTIP_EDS).parent.parent
    for folder in (packages / "palpate_host", packages / "palpate_bus", edge / "common", edge / "node"):
        for path in sorted(folder.rglob("*.py")):
            digest.update(path.name.encode() + path.read_bytes())
    return f"{__version__}+{digest.hexdigest()[:12]}"


def flat(values: Mapping[str, Any] | list[Any], above: str = "") -> dict[str, Any]:
    """Return the leaves of nested tables: ``control.tick_Hz``, ``fingers.0.joints.1.min_rad``."""
    leaves: dict[str, Any] = {}
    pairs = values.items() if isinstance(values, Mapping) else enumerate(values)
    for key, value in pairs:
        name = f"{above}{key}"
        is_table = isinstance(value, Mapping) or (isinstance(value, list) and any(map(_is_nested, value)))
        leaves |= flat(value, f"{name}.") if is_table else {name: value}
    return leaves


def _is_nested(value: object) -> bool:
    return isinstance(value, (Mapping, list))


def _lines(values: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    for key, value in values.items():
        text = _json(value)
        if len(text) <= LONGEST_VALUE or not _is_nested(value):
            yield f"{above}{key}", text
        else:
            parts = value if isinstance(value, Mapping) else {str(i): one for i, one in enumerate(value)}
            yield from _lines(parts, f"{above}{key}.")


def check_contract(log_path: Path, header: LogHeader, config: HandConfig) -> tuple[str, ...]:
    """Check that a log belongs to this hand; return what the log lacks for that, a line each.

    Raises ConfigError with the differences when the log was made with another EDS, hand.toml, model,
    calibration or node map, or when its header names no node."""
    entries = header.entries
    here = contract_header(config).entries
    if not any(key.startswith("node.") for key in entries):
        raise ConfigError(
            f"{log_path}: its header has no node.0x.., so its nodes are unknown:"
            " record it with the --header options that `palpate-host contract` prints"
        )
    _refuse(log_path, _differing_nodes(entries, here), "give the hand.toml that it was recorded with")
    rate, rate_here = (one.get(DATA_BITRATE, "none") for one in (entries, here))
    if rate != rate_here:
        _refuse(log_path, [f"{DATA_BITRATE} {rate}, here {rate_here}"], "set it in hand.toml as in the log")
    is_bound = DIGEST in entries
    if not is_bound:
        return tuple(_lacks_of_format_1(entries))
    _refuse(
        log_path,
        [
            f"{key} {entries[key]}, here {here[key]}"
            for key in (k + MEANING for k in (*EDS_FILES, *AXES_EDS_FILES))
            if key in here and _differs(key, entries, here) and entries[key] not in EARLIER_MEANINGS
        ],
        "replay it with the palpate version that made it, or record it again",
    )
    then, now = _leaves(entries), _leaves(here)
    _refuse(
        log_path,
        [
            f"{_label(key, config)} = {_json(then[key])}, here {_json(now[key])}"
            for key in now
            if key in then and then[key] != now[key]
        ],
        "give the hand.toml that it was recorded with",
    )
    if _differs(MODEL, entries, here):
        text = f"another model ({MODEL} {entries[MODEL]}, here {here[MODEL]})"
        _refuse(log_path, [text], "give the model.mjcf that it was recorded with")
    lacks = [f"{_label(key, config)}, a key of this palpate" for key in now if key not in then]
    lacks += [f"nothing, but has {key}, which this palpate does not have" for key in then if key not in now]
    unnamed = [finger.name for finger in config.fingers if finger.calibration is None]
    if unnamed:
        lacks.append(f"the calibration of {', '.join(unnamed)}: hand.toml has no fingers.calibration")
    return tuple(lacks)


def _differs(key: str, entries: Mapping[str, str], here: Mapping[str, str]) -> bool:
    return key in entries and entries[key] != here[key]


def _refuse(log_path: Path, differences: list[str], way_out: str) -> None:
    if differences:
        more = f" and {len(differences) - SHOWN} more" if len(differences) > SHOWN else ""
        raise ConfigError(f"{log_path}: was made with {'; '.join(differences[:SHOWN])}{more}: {way_out}")


def _differing_nodes(entries: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    keys = sorted(key for key in {**entries, **here} if key.startswith("node."))
    return [
        f"{key} {entries.get(key, 'missing')!r}, here {here.get(key, 'missing')!r}"
        for key in keys
        if entries.get(key) != here.get(key)
    ]


def _leaves(entries: Mapping[str, str]) -> dict[str, Any]:
    leaves: dict[str, Any] = {}
    for key, text in entries.items():
        if key.startswith(HAND) and key != DIGEST:
            try:
                leaves |= flat({key.removeprefix(HAND): json.loads(text)})
            except ValueError:
                leaves[key.removeprefix(HAND)] = text
    return leaves


def _label(key: str, config: HandConfig) -> str:
    """Return a leaf's key with the names of finger and joint in place of their numbers."""
    parts = key.split(".")
    if (
        parts[0] == "fingers"
        and len(parts) > 1
        and parts[1].isdigit()
        and int(parts[1]) < len(config.fingers)
    ):
        finger = config.fingers[int(parts[1])]
        parts[1] = finger.name
        if len(parts) > 3 and parts[2] == "joints" and int(parts[3]) < len(finger.joints):
            parts[3] = finger.joints[int(parts[3])].name
    return ".".join(parts)


def _lacks_of_format_1(entries: Mapping[str, str]) -> Iterator[str]:
    yield "the values of hand.toml, the model's digest and the calibrations (recorded by an older palpate)"
    for key, path in EDS_FILES.items():
        if entries.get(key) != checksum_of(path):
            yield f"the meaning of {path.name}, whose bytes were others ({key} {entries.get(key)})"


def _digest(value: object) -> str:
    return hashlib.sha256(_json(value).encode()).hexdigest()[:DIGITS]


def _json(value: object) -> str:
    return json.dumps(value, separators=(",", ":"), sort_keys=isinstance(value, Mapping))
