"""ansible-playbook on a board, as a person runs it."""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from deploy_rig.image import ANSIBLE, ansible

SSH = "-o StrictHostKeyChecking=no -o UserKnownHostsFile=/dev/null -o LogLevel=ERROR"


@dataclass(frozen=True)
class Played:
    """How a playbook went on its one board."""

    status: int
    changed: int
    said: str

    def well(self) -> Played:
        assert self.status == 0, self.said[-6000:]
        return self


class Playbooks:
    """Of one board: where it is reached, and the inventory's words on it."""

    def __init__(self, folder: Path, key: Path, group: str, name: str, **variables: Any) -> None:
        self._folder, self._key, self._group, self._name = folder, key, group, name
        self.variables = {"ansible_user": "root", "base_apt_update": False, **variables}

    def play(self, book: str, *words: str, prefix: list[str], **variables: Any) -> Played:
        """One playbook with these words; prefix: what stands before the command."""
        board = {**self.variables, **variables}
        board["ansible_ssh_private_key_file"] = str(self._key)
        board["ansible_ssh_common_args"] = SSH
        inventory = self._folder / "inventory.json"
        inventory.write_bytes(msgspec.json.encode({self._group: {"hosts": {self._name: board}}}))
        command = [*prefix, ansible("ansible-playbook"), "-i", inventory, ANSIBLE / f"{book}.yml", *words]
        surroundings = {
            **os.environ,
            "ANSIBLE_CONFIG": str(ANSIBLE / "ansible.cfg"),
            "ANSIBLE_LOCAL_TEMP": str(self._folder / "ansible"),
            "ANSIBLE_SSH_CONTROL_PATH_DIR": str(self._folder / "cp"),
            "ANSIBLE_NOCOLOR": "1",
            "PATH": f"{ansible('').absolute()}:{os.environ['PATH']}",
        }
        answer = subprocess.run(command, capture_output=True, text=True, env=surroundings, check=False)
        said = answer.stdout + answer.stderr
        counts = re.findall(r" changed=(\d+) ", said)
        return Played(answer.returncode, int(counts[-1]) if counts else -1, said)
