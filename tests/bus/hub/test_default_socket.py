"""The hub's socket without $PALPATE_HUB and $XDG_RUNTIME_DIR: in a folder that is this user's alone."""

from __future__ import annotations

import os
import tempfile

import can
import pytest

from palpate_bus.hub.default_socket import default_socket
from palpate_edge.common.errors import BusError


@pytest.fixture
def folder(monkeypatch, tmp_path):
    monkeypatch.delenv("PALPATE_HUB", raising=False)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path / f"palpate-{os.geteuid()}"


def test_the_folder_is_made_for_this_user_alone(folder):
    assert default_socket() == folder / "palpate-hub.sock"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert default_socket() == folder / "palpate-hub.sock"


def test_a_folder_that_others_may_use_is_refused(folder):
    folder.mkdir()
    folder.chmod(0o777)
    with pytest.raises(BusError, match=r"is open to other users, or theirs: remove it, or set PALPATE_HUB"):
        default_socket()
    with pytest.raises(can.CanInitializationError, match="open to other users"):
        can.Bus(interface="palpate")


def test_a_link_to_a_folder_is_refused(folder, tmp_path):
    (tmp_path / "theirs").mkdir(mode=0o700)
    folder.symlink_to(tmp_path / "theirs")
    with pytest.raises(BusError, match="is open to other users, or theirs"):
        default_socket()


def test_the_environment_comes_first(folder, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    assert default_socket() == tmp_path / "run" / "palpate-hub.sock"
    monkeypatch.setenv("PALPATE_HUB", str(tmp_path / "named.sock"))
    assert default_socket() == tmp_path / "named.sock"
    assert not folder.exists()
