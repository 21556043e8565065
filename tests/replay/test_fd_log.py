"""The log of a hand on a CAN FD bus: it replays to its own frames, exports, and belongs to such a hand."""

from __future__ import annotations

import csv
import gzip
import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from palpate_bus.logs.candump import read_log
from palpate_edge.common.errors import ConfigError
from palpate_host.cli.main import cli
from palpate_host.common.mode import Mode
from palpate_host.service.contract import check_contract
from palpate_host.service.host import load_hand
from palpate_host.service.replay import on_bus_clock, replay_to_log, write_output

HERE = Path(__file__).parent
TABLE_4 = HERE.parents[1] / "host" / "palpate_host" / "models" / "table4.toml"
TIPS = (0x10, 0x11, 0x12)
TPDO_10 = 0x400


def load_scenarios():
    full = "palpate_replay_scenarios"
    if full not in sys.modules:
        spec = importlib.util.spec_from_file_location(full, HERE / "scenarios.py")
        sys.modules[full] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[full])
    return sys.modules[full]


@pytest.fixture(scope="module")
def classic():
    return load_hand(TABLE_4)


@pytest.fixture(scope="module")
def hand(classic):
    return load_scenarios().on_fd_bus(classic[0]), classic[1]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("fd") / "fd.log"
    path.write_bytes(gzip.decompress((HERE / "fd.log.gz").read_bytes()))
    return path


def test_the_replay_gives_the_golden_answers_and_the_hosts_own_frames(tmp_path, log, hand):
    result = replay_to_log(log, *hand)
    assert result.modes == (Mode.INIT, Mode.CHECK, Mode.READY, Mode.GRASP, Mode.MANIPULATE)
    write_output(tmp_path / "answers.log", result)
    golden = gzip.decompress((HERE / "fd.answers.log.gz").read_bytes())
    assert (tmp_path / "answers.log").read_bytes() == golden
    nodes = hand[0].node_names
    host_ids = {0x000, 0x080, 0x1FF, 0x77F} | {base + node for node in nodes for base in (0x200, 0x600)}
    sent = [one for one in read_log(log).records if one.frame.can_id in host_ids]
    assert list(result.records) == sent


def test_contacts_are_the_only_fd_frames_of_the_log(log):
    fd = [record.frame for record in read_log(log).records if record.frame.fd]
    assert {frame.can_id for frame in fd} == {TPDO_10 + node for node in TIPS}
    assert {len(frame.data) for frame in fd} == {32}


def test_the_export_has_the_contacts(tmp_path, log, hand):
    """The object of the run: 1.5 mm times the finger's number, -4 mm, 29.7 mm; 1 N."""
    text = TABLE_4.read_text()
    on_fd = text.replace('interface = "palpate"', 'interface = "palpate"\ndata_bitrate = 5_000_000')
    assert on_fd != text
    (tmp_path / "hand.toml").write_text(on_fd)
    arguments = ["export", str(log), "--config", str(tmp_path / "hand.toml"), "-o", str(tmp_path / "fd.csv")]
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code == 0, done.output
    with (tmp_path / "fd.csv").open(newline="") as file:
        row = list(csv.DictReader(file))[-1]
    for number, finger in enumerate(hand[0].fingers):
        columns = [f"observation.tactile.{finger.name}.{name}" for name in ("x_mm", "y_mm", "z_mm", "fn_N")]
        found = [float(row[column]) for column in columns]
        assert found == pytest.approx([1.5 * number, -4.0, 29.7, 1.0])


def test_a_classic_hand_refuses_it_and_names_the_key(log, classic):
    with pytest.raises(ConfigError, match=r"bus\.data_bitrate 5000000, here none: set it in hand\.toml"):
        check_contract(log, read_log(log).header, classic[0])


def test_a_recorder_with_another_zero_is_put_on_the_bus_clock(log):
    records = read_log(log).records
    shifted = [replace(record, stamp_us=record.stamp_us + 7_000_000) for record in records]
    back = on_bus_clock(shifted, TIPS)
    assert abs(back[0].stamp_us - records[0].stamp_us) < 2_000
