"""palpate-apply: a command runs exactly when its files have not been loaded, whatever was interrupted."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from deploy_rig.image import ANSIBLE

SCRIPT = ANSIBLE / "roles/base/files/palpate-apply.sh"


@pytest.fixture
def apply(tmp_path: Path) -> Callable[..., str]:
    """Runs the script with its folders in tmp_path; `loaded` has a line for each run of the command."""
    text = SCRIPT.read_text().replace("/run/", f"{tmp_path}/run/").replace("/var/lib/", f"{tmp_path}/var/")
    script = tmp_path / "palpate-apply"
    script.write_text(text)

    def run(*options: str, command: str = "cat conf >>loaded") -> str:
        words = ["sh", script, *options, "name", "conf", "--", "sh", "-c", command]
        return subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, check=False).stdout.strip()

    return run


def start_again(folder: Path) -> None:
    for path in (folder / "run/palpate-apply").iterdir():
        path.unlink()


def loaded(folder: Path) -> list[str]:
    return (folder / "loaded").read_text().split() if (folder / "loaded").exists() else []


def test_a_changed_file_is_applied_once(apply: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "conf").write_text("a\n")
    assert [apply(), apply()] == ["applied", "unchanged"]
    (tmp_path / "conf").write_text("b\n")
    assert [apply(), apply()] == ["applied", "unchanged"]
    assert loaded(tmp_path) == ["a", "b"]


def test_a_command_that_failed_or_was_killed_runs_again(apply: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "conf").write_text("a\n")
    assert apply(command="false") == ""
    assert apply(command="kill -9 $PPID") == ""
    assert apply() == "applied"


def test_after_a_start_the_command_runs_again_and_nothing_has_changed(
    apply: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "conf").write_text("a\n")
    apply()
    start_again(tmp_path)
    assert apply() == "unchanged"
    assert loaded(tmp_path) == ["a", "a"]
    start_again(tmp_path)
    assert apply("--boot-loads") == "unchanged"
    assert loaded(tmp_path) == ["a", "a"]


def test_a_file_that_was_changed_before_a_start_is_applied(apply: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "conf").write_text("a\n")
    apply("--boot-loads")
    (tmp_path / "conf").write_text("b\n")
    start_again(tmp_path)
    assert apply("--boot-loads") == "applied"
    (tmp_path / "conf").unlink()
    assert apply("--boot-loads", command="true") == "applied"
