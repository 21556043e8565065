"""State of a provisioned board: its files, its units, and what its programs have loaded.

Nothing here asks palpate's own programs: an error in them must not hide itself.
"""

from __future__ import annotations

import re
import subprocess

from deploy_rig.fingertip_board import SERVICE, FingertipBoard
from deploy_rig.playbooks import SSH

PRUNED = "-path '/opt/palpate/releases/*/*' -prune"
LIST = (
    f"find /etc /usr/local /opt/palpate {PRUNED} -o -printf '%p\\t%y %l %m %u:%g\\n'; "
    f"find /etc /usr/local /opt/palpate {PRUNED} -o -type f -exec sha256sum {{}} + | "
    "sed -E 's/^([0-9a-f]+)  (.*)/\\2 (content)\\t\\1/'"
)
# Keys and numbers of a board, backups and caches of Debian's programs, and locks.
VOLATILE = re.compile(
    r"/etc/(machine-id|ld\.so\.cache|\.pwd\.lock|.*-|ssh/ssh_host_.*|chrony/chrony\.keys|.*/__pycache__.*)"
    r"( \(content\))?|/opt/palpate/lock.*"
)
INSTALLED = (
    "cd /opt/palpate/current/ && find . -type f -not -path '*/__pycache__/*' -printf '%p %s\\n' | "
    "sort | sha256sum"
)
UNITS = (
    *(SERVICE, "palpate-settle.service", "palpate.target", "chrony.service", "systemd-networkd.service"),
    *("tmp.mount", "apt-daily.timer", "apt-daily-upgrade.timer", "man-db.timer", "dpkg-db-backup.timer"),
)
READ_AT_START = {
    SERVICE: ("/etc/palpate/fingertip.toml", "/etc/palpate/fingertip.cal", f"/etc/systemd/system/{SERVICE}"),
    "chrony.service": ("/etc/chrony/conf.d/palpate.conf",),
    "systemd-journald.service": ("/etc/systemd/journald.conf.d/palpate.conf",),
}


def card_state(board: FingertipBoard) -> dict[str, str]:
    """Return the board's state, equal for two boards that serve the same.

    Paths, names of units and so on -> what they are.
    """
    lines = [line.split("\t") for line in board.machine.run("sh", "-c", LIST).splitlines()]
    state = {path: what for path, what in lines if not VOLATILE.fullmatch(path)}
    state["files of the active release"] = board.machine.run("sh", "-c", INSTALLED, check=False)
    for unit in UNITS:
        words = ("ActiveState", "UnitFileState", "NeedDaemonReload")
        state[unit] = " ".join(board.shown(word, unit) for word in words)
    for unit, files in READ_AT_START.items():
        state[f"{unit} has read its files"] = str(_has_read(board, unit, files))
    state["watchdog"] = board.machine.run("systemctl", "show", "--value", "--property=RuntimeWatchdogUSec")
    state["ssh"] = _logins(board)
    state["running release"] = running_release(board)
    return state


def running_release(board: FingertipBoard) -> str:
    """Return the release whose libraries the fingertip's process has mapped."""
    maps = board.machine.run("cat", f"/proc/{board.shown('MainPID')}/maps", check=False)
    return ", ".join(sorted(set(re.findall(r"/opt/palpate/releases/([^/]+)/", maps))))


def _has_read(board: FingertipBoard, unit: str, files: tuple[str, ...]) -> bool:
    """Return whether a unit's process was started after its files were written."""
    words = ("show", "--timestamp=unix", "--value", "--property=ExecMainStartTimestamp", unit)
    started_s = board.machine.run("systemctl", *words).removeprefix("@")
    written_s = board.machine.run("stat", "--format=%Y", *files, check=False).split()
    return len(written_s) == len(files) and int(started_s or 0) >= max(map(int, written_s))


def _logins(board: FingertipBoard) -> str:
    """Return the methods of login that the running sshd offers."""
    options = ("-o", "PreferredAuthentications=none", *SSH.split())
    refused = subprocess.run(
        [board.machine.folder / "ssh", *options, "root@127.0.0.1"],
        capture_output=True,
        text=True,
        check=False,
    )
    return refused.stderr.strip()
