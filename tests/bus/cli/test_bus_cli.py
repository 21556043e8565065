"""The commands of ``palpate-host bus`` against a running hub."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
from click.testing import CliRunner

from palpate_bus.cli.main import bus
from palpate_bus.logs.candump import LogHeader, LogRecord, read_log, write_log
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError, ConfigError

WAIT_S = 60  # for a process on a busy machine
MAIN = "from palpate_bus.cli.main import bus; bus()"


def run(*arguments):
    return CliRunner().invoke(bus, [str(argument) for argument in arguments], catch_exceptions=False)


def test_fault_commands_reach_the_hub_and_stats_shows_them(hub, open_edge):
    a, b = open_edge("a"), open_edge("b")
    socket = ("--socket", hub.path)
    assert run("fault", "drop", *socket, "--id", "0x190", "--mask", "0x7F0", "--count", 9).exit_code == 0
    assert (
        run("fault", "delay", *socket, "--port", "b", "--delay-ms", 0.5, "--delay-max-ms", 2).exit_code == 0
    )
    assert run("fault", "bus-off", *socket, "--port", "nobody", "--duration-ms", 60000).exit_code == 0
    a.send([CanFrame(0x19A), CanFrame(0x080)])
    assert [frame.can_id for _, frame in b.receive(20)] == [0x080]
    shown = run("stats", *socket).output
    assert "fault drop on any port, id 190/7F0: 1 hits" in shown
    assert "fault delay on b, any id: 0 hits" in shown
    assert "fault bus-off on nobody" in shown
    assert "080" in shown.split("share")[1]
    assert run("fault", "clear", *socket).exit_code == 0
    a.send([CanFrame(0x19A)])
    assert [frame.can_id for _, frame in b.receive(20)] == [0x19A]


@pytest.mark.parametrize(
    "arguments",
    [
        ("fault", "drop", "--id", "0x800"),
        ("fault", "drop", "--id", "ring"),
        ("fault", "delay"),
        ("fault", "bus-off"),
        ("fault", "bus-off", "--port", "a", "--count", 1),
        ("fault", "drop", "--probability", 2),
        ("hub", "--bitrate", -1),
    ],
)
def test_wrong_options_are_usage_errors(arguments):
    result = run(*arguments)
    assert result.exit_code == 2
    assert "Usage:" in result.output


def test_a_refused_fault_is_an_error_with_the_way_out(hub):
    with pytest.raises(BusError, match="below minimum"):
        run("fault", "delay", "--socket", hub.path, "--delay-ms", 5, "--delay-max-ms", 1)


def test_log_writes_what_was_on_the_bus_until_sigterm(hub, open_edge, tmp_path):
    a, b = open_edge("a"), open_edge("b")
    command = ["log", str(tmp_path / "bus.log"), "--socket", str(hub.path), "--header", "origin=test"]
    logger = subprocess.Popen([sys.executable, "-c", MAIN, *command], stderr=subprocess.PIPE, text=True)
    path, end_s = tmp_path / "bus.log", time.monotonic() + WAIT_S
    while not path.exists() or "7F0#" not in path.read_text():  # until the logger surely listens
        assert logger.poll() is None and time.monotonic() < end_s
        a.send([CanFrame(0x7F0)])
        time.sleep(0.05)
    a.send([CanFrame(0x190, b"\x01\x02\x03"), CanFrame(0x701, remote=True)])
    heard = []
    while not heard or heard[-1][1].can_id != 0x701:
        assert time.monotonic() < end_s
        heard += b.receive(1)
    while "701#R" not in path.read_text():
        assert logger.poll() is None and time.monotonic() < end_s
        time.sleep(0.05)
    logger.terminate()
    log = read_log(path)
    assert f"{len(log.records)} frames" in logger.communicate(timeout=WAIT_S)[1]
    assert log.header.entries == {"origin": "test"}
    assert [(record.stamp_us, record.frame) for record in log.records] == heard[-len(log.records) :]


def test_log_header_needs_key_and_value(hub, tmp_path):
    with pytest.raises(ConfigError, match="KEY=VALUE"):
        run("log", tmp_path / "bus.log", "--socket", hub.path, "--duration", 0, "--header", "origin")


def test_pcap_of_a_log(tmp_path):
    write_log(tmp_path / "bus.log", LogHeader(), [LogRecord(7, CanFrame(0x190, b"\x01"))])
    assert run("pcap", tmp_path / "bus.log", tmp_path / "bus.pcap").exit_code == 0
    content = (tmp_path / "bus.pcap").read_bytes()
    assert content[:4] == bytes.fromhex("d4c3b2a1")  # little-endian pcap with microseconds
    assert content[20:24] == bytes.fromhex("e3000000")  # link type 227
    assert content[40:] == bytes.fromhex("00000190 01 000000 01")


@pytest.mark.parametrize(
    "command", [(), ("hub",), ("log",), ("stats",), ("fault",), ("fault", "drop"), ("pcap",)]
)
def test_help(command):
    result = run(*command, "--help")
    assert result.exit_code == 0
    assert "Usage:" in result.output


def test_stats_without_a_hub_says_how_to_start_one(tmp_path):
    with pytest.raises(BusError, match=r"start the local hub .palpate-host bus hub"):
        run("stats", "--socket", tmp_path / "none.sock")
