"""Playbooks by ansible-lint's strictest profile, units by systemd, and that no secret is among them."""

from __future__ import annotations

import os
import re
import subprocess

import pytest

from deploy_rig.image import ANSIBLE, PROJECT, TOOLS, ansible
from palpate_edge.can_bus import socketcan_link

pytestmark = pytest.mark.deploy_lint

# Private keys, vaults, passwords with a value that is no variable.
SECRET = re.compile(
    r"PRIVATE KEY|\$ANSIBLE_VAULT|(?:password|passwd|secret|token)\w*\s*[:=]\s*['\"]?[^\s'\"{}]{6,}"
)


def run(*words):
    if not TOOLS.exists():
        pytest.skip("ansible is missing: make .venv-deploy/stamp")
    surroundings = {**os.environ, "PATH": f"{TOOLS}:{os.environ['PATH']}", "NO_COLOR": "1"}
    return subprocess.run(words, capture_output=True, text=True, cwd=ANSIBLE, env=surroundings, check=False)


@pytest.mark.slow
def test_the_playbooks_pass_the_production_profile():
    answer = run(ansible("ansible-lint"), "--profile", "production", "-c", ".ansible-lint.yml", ".")
    assert answer.returncode == 0, answer.stdout + answer.stderr
    files = re.findall(r"(\d+) files processed", answer.stderr)
    assert int(files[0]) >= 30


def test_the_example_inventory_has_three_fingertips_and_a_host():
    answer = run(ansible("ansible-inventory"), "-i", "inventory/example", "--graph")
    assert re.findall(r"--(finger-\d|hand)\b", answer.stdout) == ["finger-1", "finger-2", "finger-3", "hand"]


def test_node_ids_of_the_example_differ():
    hosts = (ANSIBLE / "inventory/example/hosts.yml").read_text()
    ids = re.findall(r"fingertip_node_id: (0x1[0-9A-F])", hosts)
    assert len(ids) == len(set(ids)) == 3


def test_a_board_lets_a_can_socket_have_the_receive_buffer_that_it_asks_for():
    kernel = (ANSIBLE / "roles/base/files/sysctl.conf").read_text()
    allowed = re.findall(r"^-net\.core\.rmem_max = (\d+)$", kernel, re.MULTILINE)
    assert allowed == [str(socketcan_link._BUFFER_BYTES)]


def test_no_secret_is_committed():
    listed = ["git", "ls-files", "ansible", "systemd", "tests/deploy"]
    answer = subprocess.run(listed, capture_output=True, text=True, cwd=PROJECT, check=False)
    if answer.returncode:
        pytest.skip("git is missing, or this is no clone")
    paths = [
        PROJECT / name for name in answer.stdout.split() if not name.endswith("test_what_is_committed.py")
    ]
    found = [str(path) for path in paths if SECRET.search(path.read_text(errors="replace"))]
    assert found == []


def test_a_secret_would_be_found():
    for text in (
        "-----BEGIN OPENSSH PRIVATE KEY-----",
        "wifi_password: hunter2hunter2",
        "$ANSIBLE_VAULT;1.1",
    ):
        assert SECRET.search(text)
    assert not SECRET.search("PasswordAuthentication no")
