"""One key of a finger set in the text of hand.toml; everything else, comments too, stays as it is."""

from __future__ import annotations

import json
import re
from pathlib import Path

import msgspec

from palpate_edge.common.errors import ConfigError
from palpate_host.config.hand_reader import parse

FINGER = re.compile(r"^\s*\[\[\s*fingers\s*\]\]")
TABLE = re.compile(r"^\s*\[")


def with_finger_key(path: Path, text: str, finger: str, key: str, value: str | int) -> str:
    """Return the text with fingers[].`key` = `value` for the finger of this name.

    path: of the file, for messages. Raises ConfigError, with the line to write by hand, when the text has
    another layout than a key a line under [[fingers]], and as `parse`.
    """
    config = parse(path, text)
    line = f"{key} = {json.dumps(value)}"
    numbers = [number for number, one in enumerate(config.fingers) if one.name == finger]
    lines = text.splitlines(keepends=True)
    starts = [place for place, one in enumerate(lines) if FINGER.match(one)]
    by_hand = ConfigError(f"{path}: write {line} under [[fingers]] of {finger} by hand")
    if not numbers or len(starts) != len(config.fingers):
        raise by_hand
    place = starts[numbers[0]] + 1
    end = next((i for i in range(place, len(lines)) if TABLE.match(lines[i])), len(lines))
    old = re.compile(rf"^(\s*){key}\s*=\s*(\"[^\"]*\"|\w+)")
    for number in range(place, end):
        if old.match(lines[number]):
            lines[number] = old.sub(lambda match: f"{match[1]}{line}", lines[number])
            break
    else:
        lines.insert(place, f"{line}\n")
    changed = "".join(lines)
    fingers = list(config.fingers)
    fingers[numbers[0]] = msgspec.structs.replace(fingers[numbers[0]], **{key: value})
    try:
        is_right = parse(path, changed) == msgspec.structs.replace(config, fingers=tuple(fingers))
    except ConfigError:
        is_right = False
    if not is_right:
        raise by_hand
    return changed
