"""Random power cuts during an update, on a disk, with a kernel and its file system.

update.yml runs once on a board in user-mode Linux, and every write to its disk and every flush is recorded.
Each cut then has the writes before a random place of this record, and half of the cuts lose a part of what
the disk had in its cache (deploy_rig/power_cuts.py). The board's kernel mounts the disk of each cut, and one
process reads what is there; every tenth disk is booted until it serves.

PALPATE_CUTS is the number of cuts, PALPATE_SEED draws them, PALPATE_BOOT_EVERY is another number than ten.
"""

from __future__ import annotations

import os
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from deploy_rig.fingertip_board import SlowCamera, release_of
from deploy_rig.image import changed_wheelhouse, missing
from deploy_rig.mounting_kernel import mounting_kernel
from deploy_rig.playbooks import Playbooks
from deploy_rig.power_cuts import Cut, drawn, fault, served_from
from deploy_rig.provisioned_card import provisioned_card
from deploy_rig.user_mode_board import HARDWARE, SET_UP, UserModeBoard
from deploy_rig.write_log import FLUSH, CutDisk, Entry, read_log

pytestmark = pytest.mark.deploy_cuts

CUTS, SEED = int(os.environ.get("PALPATE_CUTS", "20")), int(os.environ.get("PALPATE_SEED", "1"))
BOOT_EVERY = int(os.environ.get("PALPATE_BOOT_EVERY", "10"))


@dataclass(frozen=True)
class Update:
    """A recorded update.

    disk: from before the boot; entries: of boot and update; begin: number of the update's first one.
    """

    disk: Path
    log: Path
    entries: list[Entry]
    begin: int
    old: str
    new: str


@pytest.fixture(scope="module")
def update(
    bare_board: Path, wheels: Path, slow_camera: SlowCamera, tmp_path_factory: pytest.TempPathFactory
) -> Update:
    """Provision a board, then update it to a release with another wheel of palpate, and record its disk."""
    tools = (("linux.uml", "user-mode-linux"), ("ip", "iproute2"), ("insmod", "kmod"), ("dmsetup", "dmsetup"))
    if (reason := missing(*tools)) is not None:
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("cuts")
    place = ("edge/palpate_edge/__init__.py", '"""palpate_edge:', '"""palpate_edge :')
    (folder / "newer").mkdir()
    newer = changed_wheelhouse(folder / "newer", wheels, bare_board / "key", *place)
    camera = slow_camera.presses, slow_camera.calibration
    disk = provisioned_card(folder, bare_board, wheels, camera, HARDWARE, SET_UP)
    return recorded_update(folder, disk, bare_board / "key", wheels, newer)


def recorded_update(folder: Path, disk: Path, key: Path, wheels: Path, newer: Path) -> Update:
    """Boot the disk, update the board, cut its power at the end."""
    before, log = folder / "before", folder / "log"
    subprocess.run(["cp", "--sparse=always", disk, before], check=True)
    (folder / "recorded").mkdir()
    board = UserModeBoard(folder / "recorded")
    board.boot_recorded(disk, log)
    try:
        assert board.witness()["current"] == release_of(wheels)
        begin, begin_s = len(read_log(log)), time.monotonic()
        hosts = {"finger-1": {**board.ssh, "release_wheelhouse": str(newer), "release_patience_s": 600}}
        Playbooks(folder, key, {"fingertips": hosts}).play("update").well()
        print(f"update: {time.monotonic() - begin_s:.0f} s")
    finally:
        board.power_cut()
    disk.unlink()
    entries = read_log(log)
    made = entries[begin:]
    flushes = sum(bool(entry.flags & FLUSH) for entry in made)
    print(f"{len(made)} writes, {flushes} flushes, {sum(entry.length for entry in made) / 1e6:.1f} MB")
    assert flushes > 0
    return Update(before, log, entries, begin, release_of(wheels), release_of(newer))


def test_a_board_has_one_whole_release_after_a_cut_at_any_instant(update: Update, tmp_path: Path) -> None:
    """The boots before the update's first write and after its last give the digests of both releases."""
    disk = CutDisk(update.disk, update.log, update.entries)
    between = drawn(update.entries, update.begin, CUTS, SEED)
    cuts = [Cut(update.begin), *between, Cut(len(update.entries))]
    seen, taken_s = [], {True: 0.0, False: 0.0}
    with mounting_kernel(tmp_path, update.disk) as kernel:
        for number, cut in enumerate(cuts):
            booted, begin_s = number % BOOT_EVERY == 0 or number > CUTS, time.monotonic()
            disk.cut(cut.before, cut.lost)
            seen.append(served_from(update.disk, tmp_path / "board") if booted else kernel.card())
            cut_s = time.monotonic() - begin_s
            taken_s[booted] += cut_s
            words = f"{number} of {CUTS}: before {cut.before}, {len(cut.lost)} blocks lost"
            print(f"{words}, {cut_s:.1f} s: {seen[-1]}", flush=True)
    report(update, seen, taken_s)
    whole = {each.get("current"): each.get("digest") for each in (seen[0], seen[-1])}
    assert list(whole) == [update.old, update.new]
    assert [f"{number}: {text}" for number, each in enumerate(seen) if (text := fault(each, whole))] == []


def report(update: Update, seen: list[dict[str, Any]], taken_s: dict[bool, float]) -> None:
    """Print the counts and times. taken_s: of booted and of mounted disks."""
    served = [each.get("current") for each in seen[1:-1]]
    old, new = served.count(update.old), served.count(update.new)
    print(f"{CUTS} cuts (seed {SEED}): {old} have the old release, {new} the new one")
    contacts_s = sorted(each["contact_s"] - each["waited_s"] for each in seen if "contact_s" in each)
    span = f"contact after {contacts_s[0]:.1f} to {contacts_s[-1]:.1f} s" if contacts_s else "no contact"
    print(f"{len(contacts_s)} booted in {taken_s[True]:.0f} s: {span}, less the wait for a processor")
    print(f"{len(seen) - len(contacts_s)} mounted in {taken_s[False]:.0f} s")
