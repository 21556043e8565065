"""The view of a fingertip in the terminal of this process, with a recording as its camera."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

import cv2
import pytest
from tests.edge.console.finger_toml import recorded_finger_toml
from tests.terminal_here import terminal_here

from palpate_edge.common.errors import ConfigError
from palpate_edge.common.logs import ROOT
from palpate_edge.common.terminal.notices import notices_for_later
from palpate_edge.common.terminal.screen import alternate_screen
from palpate_edge.console.terminal.watch_terminal import watch_in_terminal
from palpate_edge.daemon.config import read_config


@pytest.fixture
def config(tmp_path, drawn_dome):
    folder = tmp_path / "pictures"
    folder.mkdir()
    cv2.imwrite(str(folder / "0.png"), drawn_dome.picture(drawn_dome.beads_mm(), seed=1))
    return read_config(recorded_finger_toml(tmp_path, folder))


@pytest.mark.long
def test_a_fingertip_is_shown_commanded_and_left(config, tmp_path, capsys):
    stopped = threading.Event()
    with terminal_here() as terminal:
        terminal.start(lambda: watch_in_terminal(config, stopped))
        terminal.until(lambda screen: "▀" in screen.rows[5], "no picture")
        assert terminal.screen.rows[0].startswith("alone  live, from the camera")
        assert terminal.screen.rows[23].startswith("r record")
        terminal.press("r")
        terminal.until(lambda screen: screen.rows[22].startswith("recording under"), "no recording")
        terminal.until(lambda screen: "recording   /" in screen.text, "not shown")
        terminal.press("r")
        terminal.until(lambda screen: screen.rows[22].startswith("recording ends"), "it goes on")
        terminal.press("t")
        terminal.until(lambda screen: screen.rows[22].startswith("refused: "), "a tare without calibration")
        terminal.press("x\x1b[As")
        terminal.until(lambda screen: screen.rows[22].startswith("snapshot "), "no snapshot")
        terminal.resize(100, 30)
        terminal.until(lambda screen: screen.rows[29].startswith("r record"), "not resized")
        terminal.press("q")
        terminal.finish()
    assert len(list((tmp_path / "recordings" / "snapshots").glob("*.png"))) == 1
    assert "this console takes the camera" in capsys.readouterr().err


@pytest.mark.long
def test_the_stop_event_ends_the_view(config):
    stopped = threading.Event()
    with terminal_here() as terminal:
        terminal.start(lambda: watch_in_terminal(config, stopped))
        terminal.until(lambda screen: screen.rows[0].startswith("alone"), "nothing")
        stopped.set()
        terminal.finish()


def test_only_changed_cells_are_sent_and_a_closed_terminal_quits():
    with terminal_here(20, 4) as terminal, alternate_screen() as screen:
        screen.draw(lambda *_: [])
        terminal.until(lambda seen: "1049" in seen.modes, "no alternate screen")
        assert "7" not in terminal.screen.modes and "25" not in terminal.screen.modes
        assert screen.keys(0.0) == ""
        terminal.press("a\x1b[Bb")
        assert screen.keys(1.0) == "ab"
        terminal.press("\x04")  # end of file, which a terminal without line mode passes on
        assert screen.keys(1.0) == "\x04"


def test_without_a_terminal_there_is_no_view(monkeypatch):
    message = "--terminal needs a terminal"
    with terminal_here() as terminal:
        monkeypatch.setenv("TERM", "dumb")
        with pytest.raises(ConfigError, match=message), alternate_screen():
            pass
        monkeypatch.setenv("TERM", "xterm")
        with Path("/dev/null").open() as nothing:
            monkeypatch.setattr("sys.stdin", nothing)
            with pytest.raises(ConfigError, match=message), alternate_screen():
                pass
        assert terminal.settings_now() == terminal.settings


def test_log_lines_wait_for_the_end_of_the_view(capsys):
    logger = logging.getLogger(ROOT)
    level = logger.level
    with notices_for_later("finger-1") as notices:
        logger.info("camera lost")
        logger.debug("detail")
        assert "camera lost" in notices.take() and notices.take() == ""
        for number in range(150):
            notices.add(f"line {number}")
        assert capsys.readouterr().err == ""
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"line {number}" for number in range(50, 150)]
    assert logger.level == level and notices not in logger.handlers
