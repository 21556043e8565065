"""A recorded run: its log gives what the host did, a replay repeats it with its commands, and a changed log
is refused."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from tests.host.recorded_run import check_export, record_run, replay
from tests.tiers import seeds

from palpate_bus.logs.candump import LogHeader, LogRecord, read_log, write_log
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.cli.main import cli
from palpate_host.common.mode import Mode
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.recorded_replay import ReplayDifferenceError

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return record_run(tmp_path_factory.mktemp("run"), seed=1, seconds=1.6)


def difference(run, log) -> str:
    """The line of a replay that stops at a difference."""
    error = replay(run, log).exception
    assert isinstance(error, ReplayDifferenceError) and error.exit_status == 10
    assert "\n" not in str(error)
    return str(error)


@pytest.mark.parametrize("seed", seeds(reduced=3, full=20))
def test_the_export_is_what_was_recorded(tmp_path, seed):
    """`action` is RPDO 1 of every tick, bit for bit; mode and orientation error are the run's own."""
    run = record_run(tmp_path, seed, seconds=1.4)
    assert run.commands > 1
    check_export(run, tmp_path / "run.csv")


def test_statuses_of_the_log_are_the_hosts_own(run):
    """Except that the host's own command is not rounded to thousandths."""
    found = list(read_statuses(run.log, run.config, run.hand))
    assert len(found) == len(run.statuses)
    for ours, theirs in zip(found, run.statuses, strict=True):
        assert replace(ours, joints=()) == replace(theirs, joints=())
        for mine, own in zip(ours.joints, theirs.joints, strict=True):
            assert replace(mine, command_Nm=own.command_Nm) == own


def test_a_replay_repeats_the_run_with_its_commands(run):
    done = replay(run)
    assert done.exit_code == 0, done.output
    assert f"{len(run.statuses)} ticks: every frame of the host is as recorded" in done.stdout
    assert "manipulate" in done.stdout and "fault" not in done.stdout


def changed_log(run, path: Path, change: Callable[[list[LogRecord]], None]) -> Path:
    log = read_log(run.log)
    records = list(log.records)
    change(records)
    write_log(path, LogHeader(log.header.entries), records, log.notes)
    return path


def test_a_changed_frame_is_named(run, tmp_path):
    """One bit of a torque: time, identifier, both contents and their meaning are in the message."""
    place = [i for i, r in enumerate(read_log(run.log).records) if r.frame.can_id == 0x205][90]

    def change(records):
        data = bytearray(records[place].frame.data)
        data[3] ^= 0x01
        records[place] = LogRecord(records[place].stamp_us, CanFrame(0x205, bytes(data)))

    log = changed_log(run, tmp_path / "changed.log", change)
    record = read_log(log).records[place]
    said = difference(run, log)
    assert f"first difference at {record.stamp_us / 1e6:.6f}" in said
    assert f"recorded 205#{record.frame.data.hex().upper()} (rpdo flexion_2" in said
    assert "computed 205#" in said and "Target torque" in said


@pytest.mark.parametrize("can_id", [0x605, 0x000, 0x77F, 0x1FF, 0x080])
def test_any_frame_of_the_host_that_is_missing_is_named(run, tmp_path, can_id):
    place = next(i for i, r in enumerate(read_log(run.log).records) if r.frame.can_id == can_id)
    log = changed_log(run, tmp_path / "missing.log", lambda records: records.pop(place))
    said = difference(run, log)
    assert "first difference" in said or "fewer" in said


def test_a_missing_frame_of_a_node_is_named(run, tmp_path):
    place = [i for i, r in enumerate(read_log(run.log).records) if r.frame.can_id == 0x190][20]
    log = changed_log(run, tmp_path / "lost.log", lambda records: records.pop(place))
    assert "fewer: a frame of another node was lost" in difference(run, log)


def test_a_missing_command_is_named(run, tmp_path):
    """By the replay, which stops; by the export as something that the log lacks."""
    lines = run.log.read_text().splitlines(keepends=True)
    place = next(i for i, line in enumerate(lines) if " input " in line and "rotate" in line)
    log = tmp_path / "without.log"
    log.write_text("".join(lines[:place] + lines[place + 1 :]))
    said = difference(run, log)
    assert "1 of the host's commands or other events are missing before the tick at" in said
    exported = CliRunner().invoke(
        cli, ["export", str(log), "--config", str(run.hand_toml), "-o", str(tmp_path / "x.csv")]
    )
    assert exported.exit_code == 0 and "lacks 1 of the host's commands" in exported.stderr


def test_missing_ticks_are_named(run, tmp_path):
    log = read_log(run.log)
    ticks = [i for i, note in enumerate(log.notes) if note.kind == "tick"]
    notes = [note for i, note in enumerate(log.notes) if i not in ticks[50:53]]
    write_log(tmp_path / "gap.log", log.header, log.records, notes)
    assert "3 of the host's ticks are missing" in difference(run, tmp_path / "gap.log")


@pytest.mark.parametrize(
    ("was", "becomes", "name"),
    [
        ("f_d_N = 4.0", "f_d_N = 4.1", "control.f_d_N = 4.0, here 4.1"),
        ("max_rad = 1.2,", "max_rad = 1.1,", "fingers.finger-1.joints.flexion_1.max_rad = 1.2, here 1.1"),
        (
            "1123456789abcdef",
            "f123456789abcdef",
            'fingers.finger-2.calibration = "1123456789abcdef", here "f',
        ),
        ("drive_node = 5", "drive_node = 15", "node.0x05 'drive:flexion_2', here 'missing'"),
    ],
)
@pytest.mark.parametrize(
    "command", ["replay", "export -o x.csv", "view --save x.rrd", "lerobot -o x --task t"]
)
def test_another_hand_or_calibration_is_refused_by_name(
    run, tmp_path, monkeypatch, host_refused, command, was, becomes, name
):
    monkeypatch.chdir(tmp_path)
    other = tmp_path / "other.toml"
    text = run.hand_toml.read_text()
    assert was in text
    other.write_text(text.replace(was, becomes, 1))
    program, *output = command.split()
    said = host_refused(program, run.log, "--config", other, *output)
    assert name in said and "give the hand.toml that it was recorded with" in said


def test_comments_and_the_bus_of_hand_toml_do_not_count(run, tmp_path):
    other = tmp_path / "other.toml"
    text = "# another place\n" + run.hand_toml.read_text().replace(
        'interface = "palpate"', 'interface = "socketcan"'
    )
    other.write_text(text)
    assert replay(run, hand_toml=other).exit_code == 0


def test_a_log_without_the_hosts_records_lacks_mode_and_error(run, tmp_path):
    """Torques are those of RPDO 1 all the same; what only the host knew stays empty."""
    log = read_log(run.log)
    write_log(tmp_path / "plain.log", log.header, log.records)
    output = tmp_path / "plain.csv"
    done = CliRunner().invoke(
        cli, ["export", str(tmp_path / "plain.log"), "--config", str(run.hand_toml), "-o", str(output)]
    )
    assert done.exit_code == 0, done.stderr
    assert "plain.log lacks the host's records: commands, modes and orientation errors" in done.stderr
    with output.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["mode"] for row in rows} == {""} == {row["orientation_error_deg"] for row in rows}
    with_torque = [row for row in rows if row["action.flexion_2"]]
    assert len(with_torque) > 0.9 * len(rows)
    assert Mode.UNKNOWN not in {status.mode for status in run.statuses}
