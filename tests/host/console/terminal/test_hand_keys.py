"""Keys of the hand's terminal: stop at once, all else after Enter."""

from __future__ import annotations

import pytest

from palpate_host.common.command import Grasp, Rotate, Stop
from palpate_host.console.terminal.hand_keys import QUESTIONS, HandKeys


def pressed(*chunks):
    keys = HandKeys()
    return [keys.take(chunk) for chunk in chunks]


@pytest.mark.parametrize("chunk", [" ", "g ", " \r", "text g\r"])
def test_stop_is_one_key_whatever_comes_with_it(chunk):
    assert pressed(chunk) == [Stop()]
    assert pressed("g", chunk, "\r") == [None, Stop(), None]


def test_a_command_waits_for_enter_and_is_sent_once():
    assert pressed("g", "\r", "\r") == [None, Grasp(), None]
    assert pressed("Z", "\n") == [None, Rotate((0.0, 0.0, 10.0))]
    assert pressed("x", "\n") == [None, Rotate((-10.0, 0.0, 0.0))]


@pytest.mark.parametrize("key", QUESTIONS)
def test_another_key_or_a_paste_sends_nothing(key):
    assert pressed(key, "n", "\r") == [None, None, None]
    assert pressed(f"{key}\r", "\r") == [None, None]
    keys = HandKeys()
    keys.take(key)
    assert keys.question
    keys.take("n")
    assert not keys.question
