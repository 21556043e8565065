"""candump logs: exact, refused by line, and read by python-can."""

from __future__ import annotations

import shutil
import subprocess

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.logs.candump import (
    LogError,
    LogHeader,
    LogNote,
    LogRecord,
    LogWriter,
    format_record,
    parse_record,
    read_log,
    write_log,
)
from palpate_edge.can_bus.can_frame import FD_LENGTHS, CanFrame

# The first two lines as the manual page of candump shows the format; stamps with awkward microseconds.
LINES = [
    ("(1700000000.123456) can0 190#0011", LogRecord(1_700_000_000_123_456, CanFrame(0x190, b"\x00\x11"))),
    (
        "(1700000000.123457) vcan0 701#R",
        LogRecord(1_700_000_000_123_457, CanFrame(0x701, remote=True), "vcan0"),
    ),
    ("(0000000000.000001) can0 000#", LogRecord(1, CanFrame(0))),
    (
        "(1700000000.999999) can0 7FF#R8",
        LogRecord(1_700_000_000_999_999, CanFrame(0x7FF, bytes(8), remote=True)),
    ),
    (
        "(1700000001.000000) can0 123##1000102030405060708090A0B",
        LogRecord(1_700_000_001_000_000, CanFrame(0x123, bytes(range(12)), fd=True)),
    ),
    ("(1700000001.000001) can0 123##1", LogRecord(1_700_000_001_000_001, CanFrame(0x123, fd=True))),
]

RECORDS = st.builds(
    LogRecord,
    stamp_us=st.integers(0, 4_000_000_000_000_000),
    frame=st.one_of(
        st.builds(CanFrame, can_id=st.integers(0, 0x7FF), data=st.binary(max_size=8)),
        st.builds(
            CanFrame,
            can_id=st.integers(0, 0x7FF),
            data=st.integers(0, 8).map(bytes),
            remote=st.just(True),
        ),
        st.builds(
            CanFrame,
            can_id=st.integers(0, 0x7FF),
            data=st.sampled_from(FD_LENGTHS).flatmap(lambda n: st.binary(min_size=n, max_size=n)),
            fd=st.just(True),
        ),
    ),
    channel=st.sampled_from(["can0", "vcan1", "slcan0"]),
)


@pytest.mark.parametrize(("line", "record"), LINES)
def test_known_lines(line, record):
    assert parse_record(line) == record
    assert format_record(record) == line


@pytest.mark.parametrize("flags", "1357")
def test_a_fast_data_phase_is_read_with_any_other_flag(flags):
    """linux/can.h: BRS 1, ESI 2, FDF 4; candump of can-utils 2023 writes 5 for the first line."""
    assert parse_record(f"(1.000000) can0 190##{flags}0102").frame == CanFrame(0x190, b"\x01\x02", fd=True)


@given(RECORDS)
def test_no_microsecond_is_lost(record):
    assert parse_record(format_record(record)) == record


@given(st.text(max_size=60))
def test_any_text_is_a_record_or_a_value_error(line):
    try:
        record = parse_record(line)
    except ValueError as error:
        assert "\n" not in str(error)
    else:
        assert record.frame.can_id <= 0x7FF


@given(RECORDS, st.data())
def test_a_damaged_line_is_a_record_or_a_value_error(record, data):
    line = format_record(record)
    place = data.draw(st.integers(0, len(line) - 1))
    damaged = line[:place] + data.draw(st.text(max_size=2)) + line[place + 1 :]
    try:
        parse_record(damaged)
    except ValueError as error:
        assert "\n" not in str(error)


def test_python_can_reads_our_records(tmp_path):
    """Without the header: CanutilsLogReader takes every line for a record and stops at a comment."""
    path = tmp_path / "plain.log"
    path.write_text("".join(f"{line}\n" for line, _ in LINES))
    with can.CanutilsLogReader(path) as reader:
        messages = list(reader)
    for message, (_, record) in zip(messages, LINES, strict=True):
        assert round(message.timestamp * 1e6) == record.stamp_us
        assert (message.arbitration_id, message.is_extended_id) == (record.frame.can_id, False)
        assert (message.is_fd, message.bitrate_switch) == (record.frame.fd, record.frame.fd)
        assert (message.is_remote_frame, message.dlc) == (record.frame.remote, len(record.frame.data))
        assert message.channel == record.channel
        if not record.frame.remote:
            assert bytes(message.data) == record.frame.data


def test_we_read_what_python_can_writes(tmp_path):
    path = tmp_path / "theirs.log"
    with can.CanutilsLogWriter(path, channel="can0") as writer:
        writer.on_message_received(
            can.Message(timestamp=1.5, arbitration_id=0x190, data=b"\x01", is_extended_id=False)
        )
        writer.on_message_received(
            can.Message(timestamp=2.5, arbitration_id=0x701, is_remote_frame=True, is_extended_id=False)
        )
        writer.on_message_received(
            can.Message(
                timestamp=3.5,
                arbitration_id=0x190,
                data=bytes(48),
                is_fd=True,
                bitrate_switch=True,
                is_extended_id=False,
            )
        )
    assert [(record.stamp_us, record.frame) for record in read_log(path).records] == [
        (1_500_000, CanFrame(0x190, b"\x01")),
        (2_500_000, CanFrame(0x701, remote=True)),
        (3_500_000, CanFrame(0x190, bytes(48), fd=True)),
    ]


def test_header_and_records_come_back(tmp_path):
    path = tmp_path / "bus.log"
    header = LogHeader({"eds.fingertip": "3f0c", "node.0x10": "fingertip finger-1: left", "origin": "test"})
    records = [LogRecord(5, CanFrame(1, b"\xff")), LogRecord(5, CanFrame(2))]
    write_log(path, header, records)
    log = read_log(path)
    assert (log.header, list(log.records)) == (header, records)
    assert path.read_text().splitlines()[0] == "# palpate-log: 2"


def test_notes_stand_between_the_records_they_belong_to(tmp_path):
    """A long note is several lines, each short enough for can-utils, whose buffer is 400 bytes."""
    path = tmp_path / "bus.log"
    records = [LogRecord(1_000_005, CanFrame(1)), LogRecord(1_000_009, CanFrame(2))]
    notes = [LogNote(1_000_005, "tick", '{"a":1}'), LogNote(1_000_007, "long", "x y " * 300)]
    write_log(path, LogHeader(), records, notes)
    lines = path.read_text().splitlines()
    assert lines[1:4] == ["(0000000001.000005) can0 001#", '#! (0000000001.000005) tick {"a":1}', lines[3]]
    assert lines[-1] == "(0000000001.000009) can0 002#"
    assert max(map(len, lines)) < 390
    log = read_log(path)
    assert (log.records, log.notes) == (tuple(records), tuple(notes))
    with LogWriter(path) as writer:
        writer.note(notes[1])
        writer.write(records[0])
    assert read_log(path).notes == (notes[1],)
    with pytest.raises(LogError, match="log note"):
        LogNote(1, "tick", "\u00fc").lines()


@pytest.mark.skipif(shutil.which("log2asc") is None, reason="log2asc of can-utils is not installed")
def test_can_utils_skip_header_and_notes(tmp_path):
    path = tmp_path / "bus.log"
    write_log(path, LogHeader({"k": "v"}), [LINES[0][1]], [LogNote(1, "tick", "x" * 2000)])
    done = subprocess.run(["log2asc", "-I", path, "can0"], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert sum(" Rx " in line for line in done.stdout.splitlines()) == 1


def test_time_zone_has_no_say(tmp_path, monkeypatch):
    texts = []
    for zone in ("UTC", "Asia/Tokyo"):
        monkeypatch.setenv("TZ", zone)
        path = tmp_path / zone.replace("/", "-")
        write_log(path, LogHeader(), [LINES[0][1]])
        texts.append(path.read_bytes())
    assert texts[0] == texts[1]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("(1.000000) can0 190#00\n(1.000001) can0 190#0\n", "line 2"),
        ("(1.000000) can0 190#00\n(1.000001) can0 19", "line 2: truncated"),
        ("(2.000000) can0 190#00\n(1.000001) can0 190#\n", "line 2: time stamp decreases"),
        ("(1.0) can0 190#00\n", "line 1"),
        ("(1.000000) can0 12345678#00\n", "line 1"),
        ("(1.000000) can0 800#00\n", "line 1: identifier 0x800 has more than 11 bits"),
        ("(1.000000) can0 190##011\n", "line 1"),
        ("(1.000000) can0 190##1000102030405060708\n", "line 1: 9 bytes are not a length of CAN FD"),
        ("(1.000000) can0 190##1" + "00" * 65 + "\n", "line 1"),
        ("(1.000000) can0 190##1R\n", "line 1"),
        ("(1.000000) can0 190#000102030405060708\n", "line 1"),
        ("(1.000000) can0 190#00\n# late: header\n", "line 2"),
        ("# key: 1\n# key: 2\n", "line 2"),
        ("# no value\n", "line 1"),
        ("# palpate-log: 3\n", "format version 3, this palpate reads 1 and 2"),
        ("(1.000000) can0 190#00\n#! no time\n", "line 2: 'no time' is not a note"),
        ("#+ continues nothing\n", "line 1"),
        ("\u00fc\n", "byte 0 is not ASCII"),
    ],
)
def test_a_garbled_log_is_refused_with_its_line(tmp_path, text, said):
    path = tmp_path / "garbled.log"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LogError) as refusal:
        read_log(path)
    assert said in str(refusal.value)
    assert "garbled.log" in str(refusal.value)
    assert "\n" not in str(refusal.value)


@given(st.binary(max_size=200))
def test_any_file_is_a_log_or_a_log_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("fuzz") / "fuzz.log"
    path.write_bytes(content)
    try:
        read_log(path)
    except LogError as error:
        assert "fuzz.log" in str(error)


@pytest.mark.parametrize(
    "entries", [{"two words": "x"}, {"key": "two\nlines"}, {"": "x"}, {"a:b": "x"}, {"k": "\u00fc"}]
)
def test_a_header_that_could_not_be_read_back_is_not_written(tmp_path, entries):
    with pytest.raises(LogError, match="log header line"):
        LogWriter(tmp_path / "bus.log", LogHeader(entries))


def test_missing_file_and_directory(tmp_path):
    with pytest.raises(LogError, match="No such file"):
        read_log(tmp_path / "none.log")
    with pytest.raises(LogError, match="No such file"):
        LogWriter(tmp_path / "none" / "bus.log")
