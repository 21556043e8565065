"""ansible-playbook on boards, as a person runs it."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from deploy_rig.image import ANSIBLE, ansible

SSH = "-o StrictHostKeyChecking=no -o UserKnownHostsFile=/dev/null -o LogLevel=ERROR"


@dataclass(frozen=True)
class Played:
    """Result of a playbook; changed: on all boards together."""

    status: int
    changed: int
    said: str

    def well(self) -> Played:
        assert self.status == 0, self.said[-6000:]
        return self

    def tells(self, words: str) -> bool:
        """Return whether the output contains a text, independent of line breaks."""
        return words in " ".join(self.said.split())


class Playbooks:
    """Return the boards of an inventory: group -> board -> the inventory's words on it."""

    def __init__(self, folder: Path, key: Path, groups: dict[str, dict[str, dict[str, Any]]]) -> None:
        self._folder, self._key, self._groups = folder, key, groups

    def play(
        self,
        book: str,
        *words: str,
        kill_after: str | int = "",
        listing: Mapping[str, str] | None = None,
        **variables: Any,
    ) -> Played:
        """One playbook with these words.

        variables: of all boards. kill_after: ansible is killed after this task (its name or number).
        listing: of NamespaceBoard, to list the tasks that ran.
        """
        common = {
            "ansible_user": "root",
            "ansible_ssh_private_key_file": str(self._key),
            "ansible_ssh_common_args": SSH,
            "base_apt_update": False,
            "release_signer": f"{self._key}.pub",
            "release_interrupt": True,
        }
        described = {
            group: {"hosts": {name: {**common, **board, **variables} for name, board in boards.items()}}
            for group, boards in self._groups.items()
        }
        inventory = self._folder / "inventory.json"
        inventory.write_bytes(msgspec.json.encode(described))
        command = [ansible("ansible-playbook"), "-i", inventory, ANSIBLE / f"{book}.yml", *words]
        surroundings = {
            **os.environ,
            "ANSIBLE_CONFIG": str(ANSIBLE / "ansible.cfg"),
            "ANSIBLE_LOCAL_TEMP": str(self._folder / "ansible"),
            "ANSIBLE_SSH_CONTROL_PATH_DIR": str(self._folder / "cp"),
            "ANSIBLE_NOCOLOR": "1",
            "ANSIBLE_CALLBACK_PLUGINS": str(Path(__file__).with_name("callbacks")),
            "PATH": f"{ansible('').absolute()}:{os.environ['PATH']}",
        }
        if kill_after:
            surroundings |= {"ANSIBLE_CALLBACKS_ENABLED": "kill_after", "PALPATE_KILL_AFTER": str(kill_after)}
        if listing:
            surroundings |= {"ANSIBLE_CALLBACKS_ENABLED": "list_tasks", **listing}
        answer = subprocess.run(
            command, capture_output=True, text=True, env=surroundings, check=False, start_new_session=True
        )
        said = answer.stdout + answer.stderr
        counts = re.findall(r" changed=(\d+) ", said)
        return Played(answer.returncode, sum(map(int, counts)) if counts else -1, said)
