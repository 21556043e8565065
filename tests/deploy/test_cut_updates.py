"""Random power cuts during an update, on a disk, with a kernel and its file system.

update.yml runs once on a board in user-mode Linux, and every write to its disk is recorded. Each cut then
boots the disk with the writes before a random instant. Half of the instants are drawn by time, half by the
number of writes. PALPATE_CUTS is the number of cuts, PALPATE_SEED draws them.
"""

from __future__ import annotations

import os
import random
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from deploy_rig.fingertip_board import SlowCamera, release_of
from deploy_rig.image import changed_wheelhouse, missing
from deploy_rig.playbooks import Playbooks
from deploy_rig.provisioned_card import provisioned_card
from deploy_rig.user_mode_board import HARDWARE, SET_UP, UserModeBoard
from deploy_rig.write_log import CutDisk, Record, read_log

pytestmark = pytest.mark.deploy_cuts

CUTS, SEED = int(os.environ.get("PALPATE_CUTS", "20")), int(os.environ.get("PALPATE_SEED", "1"))
CONTACT_S = 60.0
RMEM_MAX = 1 << 20  # of ansible/roles/base/files/sysctl.conf


@dataclass(frozen=True)
class Update:
    """A recorded update.

    disk: from before the boot; records: of boot and update; begin: number of the update's first one.
    """

    disk: Path
    log: Path
    records: list[Record]
    begin: int
    old: str
    new: str


@pytest.fixture(scope="module")
def update(
    bare_board: Path, wheels: Path, slow_camera: SlowCamera, tmp_path_factory: pytest.TempPathFactory
) -> Update:
    """Provision a board, then update it to a release with another wheel of palpate, and record its disk."""
    tools = (("linux.uml", "user-mode-linux"), ("ip", "iproute2"), ("cc", "gcc"))
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
    board.boot(disk, log=log)
    try:
        assert board.witness()["current"] == release_of(wheels)
        begin, begin_s = len(read_log(log)), time.monotonic()
        hosts = {"finger-1": {**board.ssh, "release_wheelhouse": str(newer), "release_patience_s": 600}}
        Playbooks(folder, key, {"fingertips": hosts}).play("update").well()
        print(f"update: {time.monotonic() - begin_s:.0f} s")
    finally:
        board.power_cut()
    disk.unlink()
    records = read_log(log)
    written = sum(record.length for record in records[begin:])
    print(f"{len(records) - begin} writes, {written / 1e6:.1f} MB")
    return Update(before, log, records, begin, release_of(wheels), release_of(newer))


def drawn(update: Update, cuts: int, seed: int) -> list[int]:
    """Return the records before which the power is cut, in the order of the log."""
    draw, begin, end = random.Random(seed), update.begin, len(update.records)
    times = [record.time_ns for record in update.records]
    by_time = [draw.uniform(times[begin], times[-1]) for _ in range(cuts // 2)]
    found = [sum(time_ns < instant for time_ns in times) for instant in by_time]
    return sorted(found + [draw.randint(begin, end) for _ in range(cuts - cuts // 2)])


def seen_after(disk: Path, folder: Path) -> dict[str, Any]:
    """Boot a disk, which stays as it is, and return what the board has at its first contact.

    The only key is `fault` where no contact comes.
    """
    folder.mkdir()
    board = UserModeBoard(folder)
    try:
        board.boot(disk, layer=folder / "layer")
        return board.witness()
    except AssertionError as error:
        return {"fault": str(error)}
    finally:
        board.power_cut()
        (folder / "layer").unlink(missing_ok=True)


def fault(seen: dict[str, Any], whole: dict[Any, Any]) -> str:
    """Return what is wrong on a board after a cut, empty if nothing is. whole: release -> its digest."""
    if "fault" in seen:
        return str(seen["fault"])
    active, alone_s = seen["current"], seen["contact_s"] - seen["waited_s"]
    checks = (
        (active in whole, f"{active} is active"),
        (seen["running"] == active, f"{seen['running']} runs, {active} is active"),
        (seen["complete"] and seen["digest"] == whole.get(active), f"{active} is not whole"),
        (seen["previous"] != active, "previous is current"),
        (not seen["trial"], "a trial is left over"),
        (alone_s <= CONTACT_S, f"contact after {alone_s:.0f} s, not counting the wait for a processor"),
    )
    return next((text for good, text in checks if not good), "")


def test_a_board_has_one_whole_release_after_a_cut_at_any_instant(update: Update, tmp_path: Path) -> None:
    """The boots before the update's first write and after its last give the digests of both releases."""
    disk = CutDisk(update.disk, update.log, update.records)
    instants = [update.begin, *drawn(update, CUTS, SEED), len(update.records)]
    seen = []
    for number, before in enumerate(instants):
        seen.append(seen_after(disk.cut(before), tmp_path / str(number)))
        print(f"{number} of {len(instants) - 1}: cut before {before}: {seen[-1]}", flush=True)
    whole = {each.get("current"): each.get("digest") for each in (seen[0], seen[-1])}
    assert list(whole) == [update.old, update.new]
    assert [found for each in seen if (found := fault(each, whole))] == []
    assert {each["rmem_max"] for each in seen} == {RMEM_MAX}
    served = [each["current"] for each in seen[1:-1]].count(update.old)
    contacts_s = sorted(each["contact_s"] - each["waited_s"] for each in seen)
    print(f"{CUTS} cuts (seed {SEED}): {served} serve the old release, {CUTS - served} the new one")
    print(f"contact after {contacts_s[0]:.1f} to {contacts_s[-1]:.1f} s, less the wait for a processor")
