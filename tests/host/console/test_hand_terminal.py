"""``palpate-host console --terminal`` as a process on a pseudo-terminal, beside a host."""

from __future__ import annotations

from contextlib import closing

from tests.host.hand_on_hub import CLI
from tests.terminal_process import TerminalProcess

HOLDING = ("grasp", "hold", "manipulate", "blind")


def test_a_hand_is_shown_commanded_and_lost(console):
    words = "--config", str(console.config), "--socket", str(console.socket)
    with closing(TerminalProcess([*CLI, "console", "--terminal", *words], 80, 24)) as terminal:
        terminal.until(lambda screen: screen.rows[0].startswith("ready"), "not ready")
        names = [finger["name"] for finger in console.mode_now()["fingers"]]
        assert all(any(row.startswith(name) for row in terminal.screen.rows) for name in names)
        terminal.press("g")
        terminal.until(lambda screen: screen.rows[23].startswith("grasp: Enter"), "no question")
        terminal.press("\r")
        terminal.until(lambda screen: screen.rows[22].startswith("grasp: accepted"), "not accepted")
        terminal.until(lambda screen: screen.rows[0].startswith(HOLDING), "no grasp")
        terminal.press(" ")
        terminal.until(lambda screen: screen.rows[22].startswith("stop: accepted"), "not accepted")
        terminal.until(lambda screen: screen.rows[0].startswith("stop"), "no stop")
        terminal.resize(100, 30)
        terminal.until(lambda screen: screen.rows[29].startswith("SPACE stop"), "not resized")
        console.kill_host()
        terminal.until(lambda screen: screen.rows[0].startswith("no hand is running"), "loss not shown")
        terminal.press(" ")
        terminal.until(lambda screen: screen.rows[28].startswith("stop refused: no hand"), "no refusal")
        terminal.press("q")
        assert terminal.finish() == 0
        assert terminal.settings_now() == terminal.settings
        assert terminal.screen.modes == {"25", "7"}
