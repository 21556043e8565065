"""List ansible's tasks, each with a digest of the board in namespaces after it: a callback plugin for tests.

PALPATE_TASKS is a file that gets a line for each task that ran: the digest, "changed" or "unchanged", and the
name. PALPATE_WRITTEN is the folder of what the board wrote to its card, PALPATE_FIRST the number of its first
process, PALPATE_CGROUP its control group. Two tasks with the same digest left the board in the same state.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from ansible.plugins.callback import CallbackBase

# What a board writes without being told to, and traces of the logins.
PASSING = re.compile(
    r"/var/log/|/var/lib/chrony/|/tmp/|/var/tmp/|/root/\.ansible/|/run/(log|outside|chrony|user|sshd.*)/|"
    r"/run/palpate/|/run/systemd/(journal|sessions|users|netif|seats|units/log)"
)


class CallbackModule(CallbackBase):
    """A skipped task is not listed, as kill_after.py does not count it."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "aggregate"
    CALLBACK_NAME = "list_tasks"

    def v2_runner_on_ok(self, result) -> None:
        digest = hashlib.sha256("\n".join(state()).encode()).hexdigest()
        change = "changed" if result.is_changed() else "unchanged"
        with Path(os.environ["PALPATE_TASKS"]).open("a") as file:
            file.write(f"{digest[:16]} {change} {result.task_name}\n")


def state() -> Iterator[str]:
    """Return the files of the card and of /run with their last changes, and the services' processes."""
    yield from files(Path(os.environ["PALPATE_WRITTEN"]), "")
    yield from files(Path("/proc", os.environ["PALPATE_FIRST"], "root/run"), "/run")
    for group in sorted(Path(os.environ["PALPATE_CGROUP"]).rglob("*.service/cgroup.procs")):
        if group.parent.name != "ssh.service":
            for process in group.read_text().split():
                with suppress(OSError):  # it has ended
                    started = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[19]
                    yield f"{group} {process} {started}"


def files(folder: Path, name: str) -> Iterator[str]:
    """Return a line for each file: path, size and change; of a folder only what it is."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            path = f"{name}/{entry.name}"
            if PASSING.match(f"{path}/"):
                continue
            with suppress(OSError):
                seen = entry.stat(follow_symlinks=False)
                if entry.is_dir(follow_symlinks=False):
                    yield f"{path} {seen.st_mode} {seen.st_uid} {seen.st_gid}"
                    yield from files(Path(entry.path), path)
                else:
                    yield f"{path} {seen.st_mode} {seen.st_size} {seen.st_ctime_ns}"
