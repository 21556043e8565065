"""Differences of files that count as another state of a board between two tasks of a playbook."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

PLUGIN = Path(__file__).with_name("deploy_rig") / "callbacks/list_tasks.py"


@pytest.fixture(name="plugin")
def list_tasks(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The plugin, without ansible, which has an environment of its own."""
    monkeypatch.setitem(sys.modules, "ansible.plugins.callback", SimpleNamespace(CallbackBase=object))  # type: ignore[arg-type]
    specification = importlib.util.spec_from_file_location("list_tasks", PLUGIN)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture
def card(tmp_path: Path) -> Path:
    """The folder of what a board wrote."""
    for name in ("etc/palpate/fingertip.toml", "var/log/syslog", "run/palpate/palpate-finger-1.json"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("content")
    (tmp_path / "current").symlink_to("releases/a")
    return tmp_path


def written_again(card: Path) -> None:
    toml = card / "etc/palpate/fingertip.toml"
    toml.write_text("content")
    os.utime(toml, (0, 0))  # the time of a change cannot be set back


def switched(card: Path) -> None:
    (card / "new").symlink_to("releases/b")
    (card / "new").rename(card / "current")


@pytest.mark.parametrize(
    "change",
    [
        written_again,
        switched,
        lambda card: (card / "etc/palpate/fingertip.toml").chmod(0o600),
        lambda card: (card / "etc/palpate/fingertip.toml").unlink(),
        lambda card: (card / "etc/palpate").chmod(0o700),
        lambda card: (card / "etc/chrony").mkdir(),
    ],
)
def test_a_change_of_a_file_or_folder_is_another_state(
    plugin: Any, card: Path, change: Callable[[Path], object]
) -> None:
    before = list(plugin.files(card, ""))
    change(card)
    assert list(plugin.files(card, "")) != before


def test_logs_reports_and_a_file_that_came_and_went_are_not(plugin: Any, card: Path) -> None:
    before = list(plugin.files(card, ""))
    (card / "var/log/syslog").write_text("another line")
    (card / "run/palpate/palpate-finger-1.json").write_text("{}")
    (card / "etc/palpate/temporary").touch()
    (card / "etc/palpate/temporary").unlink()
    assert list(plugin.files(card, "")) == before
