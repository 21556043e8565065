"""One key of a finger in the text of hand.toml."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate_edge.common.errors import ConfigError
from palpate_host.config.finger_key import with_finger_key
from palpate_host.config.hand_reader import parse
from palpate_host.config.packaged import MODELS

PATH = MODELS / "table4.toml"
TEXT = PATH.read_text(encoding="utf-8")
OTHER, THIRD = "0123456789abcdef", "fedcba9876543210"


@pytest.mark.parametrize(("key", "value"), [("calibration", OTHER), ("software", "0.0.9"), ("serial", 43)])
@pytest.mark.parametrize("finger", ["finger-1", "finger-3"])
def test_a_key_is_added_and_nothing_else_changes(finger, key, value):
    changed = with_finger_key(PATH, TEXT, finger, key, value)
    fingers = {one.name: getattr(one, key) for one in parse(PATH, changed).fingers}
    assert fingers == dict.fromkeys(("finger-1", "finger-2", "finger-3")) | {finger: value}
    added = set(changed.splitlines()) - set(TEXT.splitlines())
    assert len(added) == 1 and len(changed.splitlines()) == len(TEXT.splitlines()) + 1


def test_a_value_is_replaced_and_its_comment_stays():
    before = TEXT.replace(
        "fingertip_node = 0x11", f'fingertip_node = 0x11\n  calibration = "{OTHER}"  # of May'
    )
    changed = with_finger_key(PATH, before, "finger-2", "calibration", THIRD)
    assert changed == before.replace(OTHER, THIRD)


@pytest.mark.parametrize(
    ("text", "finger"),
    [
        (TEXT, "finger-9"),
        (TEXT.replace("[[fingers]]", "[['fingers']]"), "finger-1"),
        (
            TEXT.replace("fingertip_node = 0x10", f"fingertip_node = 0x10\n'calibration' = '{OTHER}'"),
            "finger-1",
        ),
    ],
    ids=["no such finger", "another way to write the table", "another way to write the key"],
)
def test_another_layout_is_left_to_a_person(text, finger):
    line = f'calibration = "{THIRD}"'
    with pytest.raises(ConfigError, match=rf"write {line} under \[\[fingers\]\] of {finger} by hand"):
        with_finger_key(Path("hand.toml"), text, finger, "calibration", THIRD)
