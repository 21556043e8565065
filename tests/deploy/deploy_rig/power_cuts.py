"""Power cuts at random places of a recorded update, and what a board has after them."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deploy_rig.user_mode_board import UserModeBoard
from deploy_rig.write_log import FLUSH, Block, Entry, cached

CONTACT_S = 60.0
RMEM_MAX = 1 << 20  # of ansible/roles/base/files/sysctl.conf


@dataclass(frozen=True)
class Cut:
    """The end of the power before an entry; lost: what the disk had in its cache."""

    before: int
    lost: frozenset[Block] = frozenset()


def drawn(entries: Sequence[Entry], begin: int, cuts: int, seed: int) -> list[Cut]:
    """Return cuts from the entry `begin` on, in the order of the log.

    Half of the places are drawn by the number of entries, half by that of flushes. In half of the cuts each
    block of the disk's cache is lost with a probability of 0.5.
    """
    draw, end = random.Random(seed), len(entries)
    flushes = [number for number in range(begin, end) if entries[number].flags & FLUSH]
    found = []
    for number in range(cuts):
        if number % 2:
            before = draw.randint(begin, end)
        else:
            since = draw.randrange(len(flushes))
            before = draw.randint(flushes[since], [*flushes, end][since + 1])
        blocks = cached(entries, before) if number % 4 < 2 else []
        found.append(Cut(before, frozenset(block for block in blocks if draw.random() < 0.5)))
    return sorted(found, key=lambda cut: cut.before)


def served_from(disk: Path, folder: Path) -> dict[str, Any]:
    """Return what the witness prints on a board that boots this disk until it serves.

    The disk stays as it is. The only key is `fault` where the witness prints nothing.
    """
    folder.mkdir(exist_ok=True)
    board = UserModeBoard(folder)
    try:
        board.boot_layer(disk)
        return board.witness()
    except AssertionError as error:
        return {"fault": str(error)}
    finally:
        board.power_cut()


def fault(seen: Mapping[str, Any], whole: Mapping[Any, Any]) -> str:
    """Return what is wrong after a cut, empty if nothing is. whole: release -> digest of its files."""
    if "fault" in seen:
        return str(seen["fault"])
    active = seen["current"]
    checks = [
        (active in whole, f"{active} is active"),
        (seen["complete"] and seen["digest"] == whole.get(active), f"{active} is not whole"),
        (seen["previous"] != active, "previous is current"),
        (not seen["trial"], "a trial is left over"),
    ]
    if "contact_s" in seen:
        alone_s = seen["contact_s"] - seen["waited_s"]
        checks += [
            (seen["running"] == active, f"{seen['running']} runs, {active} is active"),
            (seen["rmem_max"] == RMEM_MAX, f"net.core.rmem_max is {seen['rmem_max']}"),
            (alone_s <= CONTACT_S, f"contact after {alone_s:.0f} s, not counting the wait for a processor"),
        ]
    return next((text for good, text in checks if not good), "")
