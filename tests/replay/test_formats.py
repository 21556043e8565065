"""Logs of other recorders: the same frames from candump, ASC and BLF; damage is told with its place; no bytes
stop the reader; `palpate-host replay` at a speed and step by step."""

from __future__ import annotations

import gzip
import random
import time
from pathlib import Path

import can
import pytest
from click.testing import CliRunner

import palpate_host
from palpate_bus.logs.candump import LogError, LogHeader, LogRecord, parse_log, write_log
from palpate_bus.logs.log_files import read_any_log
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.cli.replay import replay as replay_command
from palpate_host.service.host import load_hand
from palpate_host.service.replay import on_bus_clock, read_bound_log, replay

HERE = Path(__file__).parent
TABLE_4 = Path(palpate_host.__file__).parent / "models" / "table4.toml"
LOG = HERE / "start-up.log.gz"
SUFFIXES = (".asc", ".blf")


def records():
    return parse_log(LOG, gzip.decompress(LOG.read_bytes())).records


def write_foreign(path, frames):
    """The frames as python-can's own writers write them, channel 1."""
    with can.Logger(str(path)) as writer:
        for record in frames:
            frame = record.frame
            message = can.Message(
                timestamp=record.stamp_us / 1e6,
                arbitration_id=frame.can_id,
                is_extended_id=False,
                is_remote_frame=frame.remote,
                dlc=len(frame.data),
                data=b"" if frame.remote else frame.data,
                channel=0,
            )
            writer(message)
    return path


@pytest.fixture(params=SUFFIXES)
def foreign(request, tmp_path):
    return write_foreign(tmp_path / f"trace{request.param}", records())


def test_frames_are_the_same_in_every_format(foreign):
    ours = records()
    theirs = read_any_log(foreign).records
    assert [record.frame for record in theirs] == [record.frame for record in ours]
    zero_us = theirs[0].stamp_us - ours[0].stamp_us
    assert all(abs(a.stamp_us - b.stamp_us - zero_us) <= 100 for a, b in zip(theirs, ours, strict=True))


def test_a_replay_of_another_format_goes_through_the_same_modes(foreign, tmp_path):
    config, hand = load_hand(TABLE_4)
    here = replay(records(), config, hand)
    there = replay(read_bound_log(foreign, config), config, hand)
    assert there.modes == here.modes
    assert there.frames_in == here.frames_in


def test_a_recorder_with_another_zero_is_put_on_the_bus_clock():
    """Shifted by hours: TPDO 3 tells when it was sent, modulo 71 minutes."""
    shifted = [LogRecord(r.stamp_us - 5 * 3_600_000_000, r.frame) for r in records()]
    back = on_bus_clock(shifted, [0x10, 0x11, 0x12])
    away_us = {a.stamp_us - b.stamp_us for a, b in zip(back, records(), strict=True)}
    assert len(away_us) == 1
    assert abs((away_us.pop() + (1 << 31)) % (1 << 32) - (1 << 31)) < 1000
    assert on_bus_clock(records()[:5], [0x10]) == records()[:5]  # no TPDO 3: as it is


def test_foreign_frames_are_left_out(tmp_path):
    frames = ("190#01", "18DAF110#0102", "123##0AA", "123##1AA", "20000004#0000000000000000", "080#")
    (tmp_path / "x.log").write_text("".join(f"(1.00000{n}) can0 {f}\n" for n, f in enumerate(frames)))
    assert [r.frame.can_id for r in read_any_log(tmp_path / "x.log").records] == [0x190, 0x123, 0x080]


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("x.log", b"(1.000000) can0 190#01\nnonsense\n", "line 2"),
        ("x.log", b"(2.000000) can0 190#01\n(1.000000) can0 190#01\n", "line 2: time stamp decreases"),
        ("x.log", b"(1.000000) can0 190#01", "line 1: truncated"),
        ("x.log", b"", "contains no CANopen frame"),
        ("x.log.gz", b"no gzip at all", "not a gzip file, or damaged"),
        ("x.log.gz", gzip.compress(b"(1.000000) can0 190#01\n" * 99, mtime=0)[:-12], "truncated at byte"),
        ("x.asc", b"", "contains no CANopen frame"),
        (
            "x.asc",
            b"date Mon Jan 1 10:00:00.000 am 2024\nbase hex  timestamps absolute\n 1.0 1 190 Rx d 1 zz\n",
            "line 3",
        ),
        (
            "x.asc",
            b"base hex  timestamps absolute\n 2.0 1 190 Rx d 1 00\n 1.0 1 190 Rx d 1 00\n",
            "line 3: time stamp decreases",
        ),
        ("x.blf", b"", "byte 0"),
        ("x.blf", b"LOGG" + bytes(20), "byte 24"),
        ("x.blf", bytes(200), "damaged, or of another format"),
    ],
    ids=range(12),
)
def test_damage_is_told_with_its_place(tmp_path, name, content, problem):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError) as caught:
        read_any_log(tmp_path / name)
    assert problem in str(caught.value) and name in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_blf_that_was_cut_off_says_where(tmp_path):
    path = write_foreign(tmp_path / "x.blf", records())
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(
        LogError, match=f"byte {len(whole) // 2}: truncated, its header gives {len(whole)} bytes"
    ):
        read_any_log(path)


def test_the_first_frame_of_an_asc_file_with_a_short_header_is_not_lost(tmp_path):
    text = "base hex  timestamps absolute\n 1.0 1 190 Rx d 1 0a\n 2.0 1 191 Rx d 2 0b 0c\n"
    (tmp_path / "x.asc").write_text(text)
    frames = [record.frame for record in read_any_log(tmp_path / "x.asc").records]
    assert frames == [CanFrame(0x190, b"\x0a"), CanFrame(0x191, b"\x0b\x0c")]


def test_a_missing_log_is_named(tmp_path):
    for name in ("x.log", "x.asc", "x.blf"):
        with pytest.raises(LogError, match=r"No such file.*check the path"):
            read_any_log(tmp_path / name)


@pytest.mark.parametrize("suffix", [".log", ".log.gz", ".asc", ".blf"])
def test_no_damage_stops_the_reader(tmp_path, suffix):
    """150 logs with flipped, lost and doubled bytes each: frames or a LogError, never another exception."""
    path = tmp_path / f"x{suffix}"
    some = records()[:60]
    if suffix in SUFFIXES:
        whole = write_foreign(path, some).read_bytes()
    else:
        write_log(tmp_path / "plain", LogHeader(), some)
        plain = (tmp_path / "plain").read_bytes()
        whole = gzip.compress(plain) if suffix.endswith("gz") else plain
    dice = random.Random(7)
    refused = 0
    for _ in range(150):
        data = bytearray(whole)
        for _ in range(dice.randint(1, 6)):
            place = dice.randrange(len(data))
            data[place : place + dice.choice((0, 1, 1, 20))] = dice.randbytes(dice.choice((0, 1, 1, 4)))
        path.write_bytes(data)
        try:
            assert read_any_log(path).records
        except LogError as error:
            refused += 1
            assert len(str(error).splitlines()) == 1
    assert refused > 0


def run(*arguments, keys=None):
    options = [str(LOG), "--config", str(TABLE_4), *map(str, arguments)]
    return CliRunner().invoke(replay_command, options, input=keys, catch_exceptions=False)


def test_the_log_is_only_read(tmp_path):
    before = LOG.read_bytes()
    assert run("-o", tmp_path / "out.log").exit_code == 0
    assert LOG.read_bytes() == before


@pytest.mark.long
def test_a_speed_takes_its_time_and_changes_nothing(tmp_path):
    """0.8 s of log at twice its speed take 0.4 s or more; the answers are those of any speed."""
    assert run("-o", tmp_path / "max.log").exit_code == 0
    begin_s = time.monotonic()
    shown = run("-o", tmp_path / "2.log", "--speed", 2).output
    assert time.monotonic() - begin_s >= 0.4
    assert (tmp_path / "2.log").read_bytes() == (tmp_path / "max.log").read_bytes()
    modes = [line.split(":")[0].split()[-1] for line in shown.splitlines() if not line.startswith("note: ")]
    assert modes[:3] == ["INIT", "CHECK", "READY"]


@pytest.mark.parametrize("speed", ["0", "-1", "fast", "nan"])
def test_a_speed_is_a_number_above_zero(speed):
    assert run("--speed", speed).exit_code == 2


def test_frames_are_shown_decoded():
    shown = run("--frames").output
    assert "190  tpdo       finger-1        TPDO 1: Value of contact x" in shown
    assert "000  nmt                        start finger-1" in shown


def test_step_by_step_shows_a_frame_and_the_hosts_answer(monkeypatch):
    """Two frames by a space, then to the end of the tick, then to the next mode, then away."""
    keys = iter("  tmq")
    monkeypatch.setattr("click.getchar", lambda: next(keys))
    shown = run("--step").output.splitlines()
    incoming = [line for line in shown if line.startswith("in ")]
    outgoing = [line for line in shown if line.startswith("out ")]
    assert "boot-up" in "".join(incoming)
    assert any("reset communication" in line for line in outgoing)
    assert shown[-1].endswith("modes: init check")
    assert any("CHECK" in line for line in shown)


def test_a_frame_of_a_log_in_hexadecimal_with_a_remote_frame(tmp_path):
    path = write_foreign(tmp_path / "x.asc", [LogRecord(1_700_000_000_000_000, CanFrame(0x701, b"", True))])
    assert read_any_log(path).records[0].frame == CanFrame(0x701, b"", True)
