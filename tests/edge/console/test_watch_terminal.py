"""``palpate-edge watch --terminal`` as a process on a pseudo-terminal."""

from __future__ import annotations

import subprocess
import sys
from contextlib import closing

from tests.edge.console.finger_toml import recorded_finger_toml
from tests.terminal_process import PATIENCE_S, TerminalProcess

WATCH = [sys.executable, "-m", "palpate_edge.cli.main", "watch", "--terminal", "--config"]


def test_a_daemon_is_watched_resized_commanded_and_left_alone(rig):
    rig.until((rig.folder / "finger.watch").exists)
    with closing(TerminalProcess([*WATCH, str(rig.config)], 80, 24)) as terminal:
        terminal.until(lambda screen: "of 85" in screen.text and "frames/s" in screen.text, "no frames")
        screen = terminal.screen
        assert screen.rows[0].startswith("finger  live, from the daemon")
        assert "▀" in screen.rows[5] and screen.rows[23].startswith("r record")
        terminal.resize(120, 40)
        terminal.until(lambda screen: screen.rows[39].startswith("r record"), "not resized")
        terminal.until(lambda screen: "▀" in screen.rows[25], "the picture stays small")
        terminal.press("t")
        terminal.until(lambda screen: screen.rows[38].startswith("tare:"), "no tare")
        terminal.press("\x03")
        assert terminal.finish() == 0
        assert terminal.screen.modes == {"25", "7"}
        assert terminal.settings_now() == terminal.settings
        assert "a daemon runs and has the camera" in terminal.screen.main_text
    rig.until(lambda: not (rig.folder / "finger.pictures").exists())
    assert rig.process.poll() is None


def test_without_colours_and_daemon_q_ends_it(tmp_path, drawn_dataset):
    config = recorded_finger_toml(tmp_path, drawn_dataset)
    with closing(TerminalProcess([*WATCH, str(config)], 80, 24, NO_COLOR="1")) as terminal:
        terminal.until(
            lambda screen: "no daemon runs, so" in screen.rows[0] and "o" in screen.rows[8], "no picture"
        )
        assert terminal.screen.text.isascii()
        terminal.press("q")
        assert terminal.finish() == 0
        assert terminal.settings_now() == terminal.settings


def test_no_terminal_is_refused(tmp_path, drawn_dataset):
    config = tmp_path / "finger.toml"
    config.write_text(
        f'name = "a"\n[capture]\nsource = "recorded"\npath = "{drawn_dataset}"\n'
        '[node]\nid = 16\n[bus]\ninterface = "palpate"\n'
    )
    done = subprocess.run(
        [*WATCH, str(config)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 2
    assert "--terminal needs a terminal" in done.stderr and not done.stdout
