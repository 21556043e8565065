"""What a recorded hand did, as MCAP, CSV and Parquet; the MCAP is read by another library."""

from __future__ import annotations

import csv
import itertools
import json
import math
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from tests.host.recording.test_live_server import TOPICS

from palpate_host.cli.main import cli
from palpate_host.recording.mcap import McapRecording
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand
from palpate_host.service.replay import read_bound_log, steps

PROJECT = Path(__file__).resolve().parents[3]
LOG = PROJECT / "tests" / "replay" / "virtual.log.gz"
DEMO = PROJECT / "tests" / "replay" / "demo.log.gz"  # of an older palpate, without the host's records
HAND = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"


class JsonDecoders:
    """The mcap library has none for JSON."""

    def decoder_for(self, encoding: str, _schema: object) -> Callable[[bytes], Any] | None:
        return json.loads if encoding == "json" else None


def export(output: Path, source: Path = LOG) -> Result:
    return CliRunner().invoke(cli, ["export", str(source), "--config", str(HAND), "-o", str(output)])


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    path = tmp_path_factory.mktemp("export") / "hand.csv"
    done = export(path)
    assert done.exit_code == 0, done.stderr
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def mcap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("export") / "hand.mcap"


@pytest.fixture(scope="module")
def topics(mcap: Path) -> dict[str, list[tuple[int, Any]]]:
    return topics_of(mcap, LOG)


def topics_of(path: Path, log: Path) -> dict[str, list[tuple[int, Any]]]:
    done = export(path, log)
    assert done.exit_code == 0, done.stderr
    found = defaultdict(list)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory(), JsonDecoders()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found[channel.topic].append((message.log_time, decoded))
    return found


def test_topics_and_schemas_are_those_of_the_live_server(
    topics: dict[str, list[tuple[int, Any]]], mcap: Path
) -> None:
    assert topics.keys() == TOPICS.keys()
    with mcap.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    schemas = {number: schema.name for number, schema in summary.schemas.items()}
    assert {one.topic: schemas[one.schema_id] for one in summary.channels.values()} == TOPICS


def test_joints_of_the_mcap_are_the_rows(
    topics: dict[str, list[tuple[int, Any]]], rows: list[dict[str, str]]
) -> None:
    assert len(topics["/joint_states"]) == len(rows)
    _, states = topics["/joint_states"][-1]
    for joint in states.joints:
        assert joint.position == pytest.approx(float(rows[-1][f"observation.state.{joint.name}"]))
        assert joint.effort == pytest.approx(float(rows[-1][f"observation.effort.{joint.name}"]))


def test_transforms_are_the_hands_kinematics(
    topics: dict[str, list[tuple[int, Any]]], rows: list[dict[str, str]]
) -> None:
    """Tip to tip distances from /tf and from the model at the row's joint angles."""
    config, hand = load_hand(HAND)
    q = np.array([float(rows[-1][f"observation.state.{joint.name}"]) for joint in config.joints])
    expected = hand.pose(q).tip_centre_m
    _, message = topics["/tf"][-1]
    for transform, centre in zip(message.transforms, expected, strict=True):
        t, r = transform.translation, transform.rotation
        assert (t.x, t.y, t.z) == pytest.approx(tuple(centre))
        assert math.hypot(r.x, r.y, r.z, r.w) == pytest.approx(1.0)


def test_contacts_lie_on_the_dome(tmp_path: Path) -> None:
    """The outer radius is 30 mm; TPDO 1 rounds to 0.01 mm."""
    topics = topics_of(tmp_path / "demo.mcap", DEMO)
    for i in (1, 2, 3):
        contacts = topics[f"/tactile/finger-{i}/contact"]
        assert contacts
        for _, contact in contacts:
            p = contact.point
            assert math.hypot(p.x, p.y, p.z) == pytest.approx(0.030, abs=2e-5)
            assert contact.frame_id == f"finger-{i}"


def test_diagnostics_tell_the_way_to_the_target(topics: dict[str, list[tuple[int, Any]]]) -> None:
    said = [message.message for _, message in topics["/diagnostics"]]
    assert said[0].startswith("init: ")
    assert any(text.startswith("manipulate: ") for text in said)


def test_time_grows(topics: dict[str, list[tuple[int, Any]]]) -> None:
    for messages in topics.values():
        times = [time for time, _ in messages]
        assert times == sorted(times)


def test_parquet_holds_the_rows_of_the_csv_in_lerobots_types(
    tmp_path: Path, rows: list[dict[str, str]]
) -> None:
    """LeRobot: float32 vectors observation.state and action, float32 timestamp, int64 indices."""
    path = tmp_path / "hand.parquet"
    assert export(path).exit_code == 0
    table = pq.read_table(path)
    types = {field.name: str(field.type) for field in table.schema}
    assert types["observation.state"] == types["action"] == "fixed_size_list<element: float>[9]"
    assert types["timestamp"] == "float"
    indices = ("frame_index", "episode_index", "index", "task_index")
    assert [types[name] for name in indices] == ["int64"] * 4
    assert table.num_rows == len(rows)
    names = json.loads(table.schema.metadata[b"names"])
    seen = set()
    for row, texts in zip(table.to_pylist(), rows, strict=True):
        for name, value in row.items():
            cells = zip(names[name], value, strict=True) if name in names else [(None, value)]
            for element, cell in cells:
                text = texts[name if element is None else f"{name}.{element}"]
                seen.add(name if element is None else f"{name}.{element}")
                if isinstance(cell, float):
                    assert math.isnan(cell) if text == "" else cell == pytest.approx(float(text), rel=1e-6)
                else:
                    assert str(cell) == text
    assert seen == set(rows[0])


@pytest.mark.parametrize("source", ["hand.mcap", "."])
def test_an_mcap_tells_every_tick_again(tmp_path: Path, rows: list[dict[str, str]], source: str) -> None:
    """Also as a folder; the bus log is in it."""
    assert export(tmp_path / "hand.mcap").exit_code == 0
    assert export(tmp_path / "again.csv", tmp_path / source).exit_code == 0
    with (tmp_path / "again.csv").open(newline="") as file:
        assert list(csv.DictReader(file)) == rows
    with (tmp_path / "hand.mcap").open("rb") as file:
        (attachment,) = make_reader(file).iter_attachments()
    assert (attachment.name, attachment.data) == (LOG.name, LOG.read_bytes())


def test_an_mcap_that_was_cut_off_tells_what_it_holds(tmp_path: Path, rows: list[dict[str, str]]) -> None:
    """Half of the file: no index, no end; the first of its chunks are there."""
    config, hand = load_hand(HAND)
    path = tmp_path / "cut.mcap"
    with McapRecording(path, hand, [finger.name for finger in config.fingers]) as recording:
        for status in read_statuses(LOG, config, hand):
            recording.write(status)
            recording.flush()
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    told = list(read_statuses(path, config, hand))
    assert len(rows) // 4 < len(told) < len(rows)
    assert told == list(itertools.islice(read_statuses(LOG, config, hand), len(told)))


def test_status_lines_export_too_and_a_cut_last_line_is_left_out(tmp_path: Path) -> None:

    config, hand = load_hand(HAND)
    lines = [
        msgspec.json.encode(step.output.status) + b"\n"
        for step in steps(read_bound_log(LOG, config), config, hand)
        if step.output.frames_out
    ][:50]
    status = tmp_path / "status.jsonl"
    status.write_bytes(b"".join(lines) + lines[0][:40])
    done = export(tmp_path / "hand.csv", status)
    assert done.exit_code == 0, done.stderr
    assert "50 ticks" in done.stdout


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("hand.txt", None, "is none of .mcap, .csv, .parquet"),
        ("no-folder/hand.csv", None, "cannot be written"),
        ("no-folder/hand.mcap", None, "cannot be written"),
        ("no-folder/hand.parquet", None, "cannot be written"),
        ("hand.csv", "{}\n", "line 1: not a host status (key time_us"),
        ("hand.csv", "not-an-mcap", "not an MCAP file"),
    ],
)
def test_what_cannot_be_done_is_said(
    tmp_path: Path, host_refused: Callable[..., str], name: str, text: str | None, message: str
) -> None:
    source = LOG
    if text is not None:
        source = tmp_path / ("hand.mcap" if text.startswith("not") else "status.jsonl")
        source.write_text(text)
    assert message in host_refused("export", source, "--config", HAND, "-o", tmp_path / name)
