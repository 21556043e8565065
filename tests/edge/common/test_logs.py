"""Logs on standard error: priorities for the journal, plain text at a terminal."""

from __future__ import annotations

import logging
import os
import subprocess
import sys

import pytest

from palpate_edge.common.logs import (
    LineLimit,
    LogLine,
    RepeatedProblem,
    is_journal,
    logging_to_stderr,
    priority,
)

SERVICE = """
import logging
from palpate_edge.common.logs import logging_to_stderr
with logging_to_stderr("finger-1"):
    logging.getLogger("palpate.camera").error("camera lost")
    logging.getLogger("palpate.bus").warning("two\\nlines")
    logging.getLogger("palpate.recording").info("recording to a folder")
    logging.getLogger("palpate.recording").debug("not shown")
    logging.getLogger("foreign").warning("not ours")
"""
REFUSAL = """
import click
from palpate_edge.common.entry_point import run_cli
from palpate_edge.common.errors import BusError
@click.command()
def main():
    raise BusError("no bus")
run_cli(main)
"""
CRASH = """
import click, threading
from palpate_edge.common.entry_point import run_cli
def fail():
    raise KeyError("a fault of the program")
@click.command()
def main():
    thread = threading.Thread(target=fail, name="capture")
    thread.start()
    thread.join()
    fail()
run_cli(main)
"""


def stderr_of(tmp_path, program, *, journal):
    """Run a program; with `journal`, JOURNAL_STREAM names its standard error as systemd does."""
    path = tmp_path / "stderr"
    with path.open("wb") as stderr:
        status = os.fstat(stderr.fileno())
        name = f"{status.st_dev}:{status.st_ino}" if journal else "9:9"
        environment = os.environ | {"JOURNAL_STREAM": name}
        subprocess.run([sys.executable, "-c", program], stderr=stderr, env=environment, check=False)
    return path.read_text().splitlines()


def test_each_line_has_its_priority_in_the_journal(tmp_path):
    assert stderr_of(tmp_path, SERVICE, journal=True) == [
        "<3>finger-1: camera lost",
        "<4>finger-1: two",
        "<4>lines",
        "<6>finger-1: recording to a folder",
        "not ours",
    ]


def test_plain_text_where_standard_error_is_not_the_journals(tmp_path):
    """JOURNAL_STREAM is inherited by programs whose standard error goes elsewhere."""
    assert stderr_of(tmp_path, SERVICE, journal=False) == [
        "finger-1: camera lost",
        "finger-1: two",
        "lines",
        "finger-1: recording to a folder",
        "not ours",
    ]


@pytest.mark.parametrize(("journal", "line"), [(True, "<3>error: no bus"), (False, "error: no bus")])
def test_the_error_that_ends_a_command_is_an_error_in_the_journal(tmp_path, journal, line):
    assert stderr_of(tmp_path, REFUSAL, journal=journal) == [line]


@pytest.mark.parametrize(("journal", "prefix"), [(True, "<2>"), (False, "")])
def test_every_line_of_a_traceback_is_critical_in_the_journal(tmp_path, journal, prefix):
    """An exception of a thread, then one of the command itself."""
    lines = stderr_of(tmp_path, CRASH, journal=journal)
    assert [line for line in lines if not line.startswith(prefix)] == []
    texts = [line.removeprefix(prefix) for line in lines]
    assert texts.count("Traceback (most recent call last):") == 2
    assert texts.count("KeyError: 'a fault of the program'") == 2
    assert texts[0] == "Exception in thread capture:"
    assert texts[-1] == "KeyError: 'a fault of the program'"


@pytest.mark.parametrize(
    ("level", "number"),
    [(logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (logging.DEBUG, 7)],
)
def test_priorities_are_those_of_syslog(level, number):
    assert priority(level) == number


def test_a_closed_stream_is_not_the_journal(tmp_path):
    with (tmp_path / "file").open("w") as stream:
        status = os.fstat(stream.fileno())
        environment = {"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}
        assert is_journal(stream, environment)
        assert not is_journal(stream, {})
    assert not is_journal(stream, environment)


def test_the_handler_is_removed_at_the_end():
    logger = logging.getLogger("palpate")
    before, level = list(logger.handlers), logger.level
    with pytest.raises(KeyError), logging_to_stderr():
        assert len(logger.handlers) == len(before) + 1
        raise KeyError
    assert (logger.handlers, logger.level) == (before, level)


S = 1_000_000


def lines_of(events_us, end_us, lasts_us):
    """Return (time in s, line) of a problem that begins with each event and lasts for `lasts_us` after it."""
    repeated, lines = RepeatedProblem("foreign frames", "over"), []
    for now_us in range(0, end_us, S // 10):
        past = [at_us for at_us in events_us if at_us <= now_us]
        problem = "used twice" if past and now_us < past[-1] + lasts_us else ""
        line = repeated.update(now_us, problem, len(past))
        if line is not None:
            lines.append((now_us / S, line))
    return lines


def test_a_problem_that_begins_again_every_second_is_logged_once_and_counted_each_minute():
    """As by an attack of 338 s that ends each conflict with another node id."""
    lines = lines_of(range(5 * S, 343 * S, S), 600 * S, lasts_us=S // 2)
    counted = [
        (at_s, LogLine(logging.ERROR, f"{count} more foreign frames in the last minute"))
        for at_s, count in ((65, 60), (125, 60), (185, 60), (245, 60), (305, 60), (365, 37))
    ]
    over = (425, LogLine(logging.INFO, "over: 338 foreign frames"))
    assert lines == [(5, LogLine(logging.ERROR, "used twice")), *counted, over]


def test_a_problem_that_comes_back_after_its_end_is_logged_again():
    lines = lines_of([0, 100 * S], 200 * S, lasts_us=10 * S)
    assert [(at_s, line.level) for at_s, line in lines] == [
        (0, logging.ERROR),
        (60, logging.INFO),
        (100, logging.ERROR),
        (160, logging.INFO),
    ]


def test_lines_at_any_rate_are_ten_a_minute_and_a_number():
    """A bus that is lost and found again twice a second for two minutes."""
    limit, lines = LineLimit("changes of the bus"), []
    for now_us in range(0, 300 * S, S // 4):
        state = ("down", "up")[now_us // (S // 4) % 2]
        given = [LogLine(logging.INFO, state)] if now_us < 120 * S else []
        lines += [(now_us / S, line.text) for line in limit.update(now_us, given)]
    counted = "230 more changes of the bus in the last minute, the last: up"
    assert [(at_s, text) for at_s, text in lines if "more" in text] == [(60, counted), (120, counted)]
    assert [at_s for at_s, text in lines if "more" not in text] == [
        first + step * 0.25 for first in (0, 60) for step in range(10)
    ]


def test_a_few_lines_are_logged_at_once_and_no_number_follows():
    limit = LineLimit("changes of the bus")
    given = [LogLine(logging.ERROR, str(number)) for number in range(10)]
    assert limit.update(0, given) == given
    assert [limit.update(at_s * S) for at_s in (59, 60, 61)] == [[], [], []]
