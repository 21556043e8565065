"""Faults of configuration files in our words: file, key, value, what is allowed; never msgspec's text."""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.common.config_file import json_fault, read_toml
from palpate_edge.common.errors import CalibrationError, ConfigError, DatasetError, PalpateError
from palpate_edge.common.struct_fault import struct_fault
from palpate_edge.daemon.config import FingertipConfig, read_config
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.geometry.sensor import Sensor
from palpate_host.config import hand_reader
from palpate_host.config.hand_config import HandConfig
from palpate_host.config.packaged import MODELS
from palpate_host.drives.az import config as az_config
from palpate_host.drives.az.config import AzConfig
from palpate_host.experiment import protocol
from palpate_host.experiment.protocol import ExperimentConfig

ROOT = Path(__file__).resolve().parents[3]
FINGER = """\
name = "finger-1"
[capture]
source = "recorded"
path = "frames"
camera.exposure_us = 5000
[estimator]
calibration = "finger.cal"
[node]
id = 16
[bus]
interface = "palpate"
"""
SENSOR = (ROOT / "demo" / "recording" / "press" / "sensor.toml").read_text()
FILES: dict[str, tuple[str, Any, Callable[[Path], object], type[PalpateError]]] = {
    "finger.toml": (FINGER, FingertipConfig, read_config, ConfigError),
    "hand.toml": ((MODELS / "table4-wide.toml").read_text(), HandConfig, hand_reader.load, ConfigError),
    "az.toml": ((MODELS / "table4-az.toml").read_text(), AzConfig, az_config.load, ConfigError),
    "experiment.toml": (
        (MODELS / "experiment.toml").read_text(),
        ExperimentConfig,
        protocol.load,
        ConfigError,
    ),
    "sensor.toml": (SENSOR, Sensor, read_sensor, DatasetError),
}
NOT_OURS = re.compile(r"Object (contains|missing)|Expected `|at `\$|Invalid (enum )?value|base64-enc|msgspec")


def is_ours(text: str, path: Path) -> None:
    assert text.startswith(str(path)), text
    assert text.isprintable(), text  # one line, nothing that a terminal would obey
    assert NOT_OURS.search(text) is None, text


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[capture]", "[captur]", "unknown section [captur]; did you mean [capture]?"),
        (
            '"recorded"',
            '"webcam"',
            'capture.source = "webcam" is not one of v4l2, recorded, shared_memory',
        ),
        ("path =", "pth =", "unknown key capture.pth; did you mean capture.path?"),
        (
            "path =",
            "xyz =",
            "unknown key capture.xyz; [capture] has source, path, loop, timeout_ms, camera",
        ),
        ("[node]", "[[node]]", "node = [1 entries] is not a section [node]"),
        ("[bus]", "[pus]", "unknown section [pus]; did you mean [bus]?"),
        (
            "[bus]",
            "[[bus.pus]]",
            "unknown section [[bus.pus]]; [bus] has interface, channel, bitrate, data_bitrate, clock",
        ),
        ("[node]\nid = 16\n", "", "section [node] is missing; docs/configuration.md lists"),
        (
            "id = 16",
            "",
            "key node.id (a whole number) is missing; docs/configuration.md lists",
        ),
        (
            "id = 16",
            "id = 200",
            "node.id = 200 is out of range: it must be a whole number from 1 to 127, or 255",
        ),
        ("id = 16", 'id = "16"', 'node.id = "16" is not a whole number'),
        ("id = 16", "id = 16.5", "node.id = 16.5 is not a whole number"),
        ("id = 16", "id 16", "line 9, column 4 is not valid TOML: expected '=' after a key"),
        ("id = 16", "id = 16\nid = 17", "line 10, column 8 is not valid TOML: cannot overwrite a value"),
        ("5000", "nan", "capture.camera.exposure_us = nan is not a number"),
        (
            "5000",
            "0",
            "capture.camera.exposure_us = 0 is out of range: it must be a whole number from 1 to 1000000",
        ),
        ('"frames"', '"frames"\nloop = "yes"', 'capture.loop = "yes" is not true or false'),
        ('"finger-1"', "1979-05-27", "name = 1979-05-27 is not text in quotes"),
        ('"finger-1"', '"""', "not valid TOML: "),
        ("name =", '"na\\nme" =', 'unknown key "na\\\\nme"; did you mean name?'),
    ],
)
def test_a_fault_names_key_value_and_what_is_allowed(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "finger.toml"
    assert old in FINGER
    path.write_text(FINGER.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        read_config(path)
    is_ours(str(caught.value), path)
    assert message.replace("\\\\", "\\") in str(caught.value)


def test_a_fingertip_may_wait_for_lss_to_assign_its_id(tmp_path: Path) -> None:
    path = tmp_path / "finger.toml"
    path.write_text(FINGER.replace("id = 16", "id = 255"))
    assert read_config(path).node.id == 255


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (
            "sensor.toml",
            "wall_mm",
            "wall",
            "key dome.wall_mm (a number) is missing; docs/press-dataset.md lists",
        ),
        (
            "sensor.toml",
            "width = ",
            "width = 9000 # ",
            "camera.width = 9000 is out of range: it must be 16 to 8192",
        ),
        ("hand.toml", "[control]", "[contrl]", "unknown section [contrl]; did you mean [control]?"),
        ("hand.toml", "rpy_deg = [", "rpy_deg = [1.0, ", "target.rpy_deg has 4 entries, not 3"),
        ("az.toml", "[[ports]]", "[[port]]", "unknown section [[port]]; did you mean [[ports]]?"),
        (
            "experiment.toml",
            "[[turns]]",
            "[turns]",
            "line 17, column 8 is not valid TOML: cannot",
        ),
    ],
)
def test_every_reader_words_its_faults_alike(
    tmp_path: Path, file: str, old: str, new: str, message: str
) -> None:
    text, _, read, error = FILES[file]
    path = tmp_path / file
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(error) as caught:
        read(path)
    assert message in str(caught.value)


@pytest.mark.parametrize("file", sorted(FILES))
def test_a_file_that_is_not_there_and_a_folder(tmp_path: Path, file: str) -> None:
    _, _, read, error = FILES[file]
    with pytest.raises(error, match=rf"{file}: no such file; \S+ "):
        read(tmp_path / file)
    (tmp_path / file).mkdir(mode=0o700)
    with pytest.raises(error, match=rf"{file}: is a folder; \S+ "):
        read(tmp_path / file)


def test_bytes_that_are_no_text_are_named_by_their_line(tmp_path: Path) -> None:
    path = tmp_path / "finger.toml"
    path.write_bytes(FINGER.encode().replace(b"frames", b"fr\xff"))
    with pytest.raises(ConfigError, match=r"line 4 is not UTF-8 text: save"):
        read_config(path)


SCALARS = st.one_of(
    st.none().map(lambda _: []),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.text(max_size=6),
    st.dates(),
    st.lists(st.integers(0, 3), max_size=4),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
    st.lists(st.dictionaries(st.text(max_size=3), st.integers(), max_size=1), min_size=1, max_size=2),
)


def places(value: object, key: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Every place of a document that can be changed."""
    parts: list[tuple[str | int, object]] = []
    if isinstance(value, dict):
        parts = list(value.items())
    elif isinstance(value, list):
        parts = list(enumerate(value))
    return [(*key, part) for part, _ in parts] + [
        place for part, inner in parts for place in places(inner, (*key, part))
    ]


def mutated(document: dict[str, Any], data: st.DataObject) -> dict[str, Any]:
    """The document with one value replaced, removed, or moved to another key."""
    document = copy.deepcopy(document)
    *above, last = data.draw(st.sampled_from(places(document)))
    parent: Any = document
    for part in above:
        parent = parent[part]
    change = data.draw(st.sampled_from(["replace", "remove", "rename"]))
    if change == "replace" or isinstance(last, int):
        parent[last] = data.draw(SCALARS)
    elif change == "remove":
        del parent[last]
    else:
        parent[data.draw(st.text(max_size=12) | st.just(last[:-1]))] = parent.pop(last)
    return document


@pytest.mark.long
@pytest.mark.parametrize("file", sorted(FILES))
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_fault_is_found_exactly_when_msgspec_refuses(file: str, data: st.DataObject) -> None:
    text, kind, _, _ = FILES[file]
    document = mutated(tomllib.loads(text), data)
    fault = struct_fault(document, kind)
    try:
        msgspec.convert(document, kind)
    except msgspec.ValidationError:
        assert fault is not None
        assert fault.isprintable()
        assert NOT_OURS.search(fault) is None
    else:
        assert fault is None


@pytest.mark.parametrize("file", sorted(FILES))
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0), damage=st.binary(max_size=6), cut=st.integers(0, 40))
@example(place=0, damage=b"a = " + b"[" * 5000 + b"\n", cut=0)
@example(place=0, damage=b"a = " + b"9" * 5000 + b"\n", cut=0)
def test_damaged_bytes_are_read_or_refused_in_our_words(
    tmp_path: Path, file: str, place: int, damage: bytes, cut: int
) -> None:
    text, _, read, error = FILES[file]
    whole = text.encode()
    place %= len(whole)
    path = tmp_path / file
    path.write_bytes(whole[:place] + damage + whole[place + cut :])
    try:
        read(path)
    except error as refusal:
        is_ours(str(refusal), path)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0), damage=st.binary(max_size=6), cut=st.integers(1, 40))
def test_a_damaged_calibration_is_refused_in_our_words(
    tmp_path: Path, drawn_calibration_file: Path, place: int, damage: bytes, cut: int
) -> None:
    whole = drawn_calibration_file.read_bytes()
    place %= len(whole)
    if whole[place : place + cut] == damage:
        return
    path = tmp_path / "finger.cal"
    path.write_bytes(whole[:place] + damage + whole[place + cut :])
    with pytest.raises(CalibrationError) as caught:
        load_calibration(path)
    is_ours(str(caught.value), path)
    assert "palpate-edge calibrate" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"appearance"', '"apearance"', "unknown section [apearance]; did you mean [appearance]?"),
        ('"beads": [', '"beads": [3, ', "beads[0] = 3 is not a section [beads]"),
        ('"version": ', '"version": "" ', "is not valid JSON: cut short or damaged"),
        ('"version": ', '"version": 0.5', "version = 0.55 is not a whole number"),
    ],
)
def test_faults_of_a_calibration(drawn_calibration_file: Path, old: str, new: str, message: str) -> None:
    text = drawn_calibration_file.read_text()
    assert old in text
    assert message in json_fault(text.replace(old, new, 1).encode(), Calibration)


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0), damage=st.binary(max_size=6), cut=st.integers(0, 40))
def test_a_damaged_truth_is_read_or_refused_in_our_words(
    tmp_path_factory: pytest.TempPathFactory, drawn_dataset: Path, place: int, damage: bytes, cut: int
) -> None:
    folder = tmp_path_factory.mktemp("dataset")
    for name in ("sensor.toml", "reference", "frames"):
        (folder / name).symlink_to(drawn_dataset / name)
    whole = (drawn_dataset / "truth.csv").read_bytes()
    place %= len(whole)
    (folder / "truth.csv").write_bytes(whole[:place] + damage + whole[place + cut :])
    try:
        read_dataset(folder)
    except DatasetError as refusal:
        is_ours(str(refusal), folder / "truth.csv")


def test_a_file_that_everybody_may_write_is_refused_where_it_decides(tmp_path: Path) -> None:
    path = tmp_path / "finger.toml"
    path.write_text(FINGER)
    path.chmod(0o666)
    with pytest.raises(ConfigError, match=r"may be written by everybody .mode 666.: chmod o-w"):
        read_toml(path, FingertipConfig, guide="see the page")
    assert read_toml(path, FingertipConfig, guide="see the page", trusted=False).name == "finger-1"
