"""Files appear complete or not at all; devices, links and standard output are written through."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from palpate_edge.common.atomic_write import (
    atomic_file,
    atomic_path,
    atomic_text,
    make_folder,
    write_atomically,
)
from palpate_edge.common.errors import ConfigError, DatasetError

FULL = Path("/dev/full")


def test_content_appears_at_the_end_and_nothing_else_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("before")
    with atomic_text(path, ConfigError) as file:
        file.write("after")
        file.flush()
        assert path.read_text() == "before"
    assert path.read_text() == "after"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("failure", [KeyboardInterrupt, ValueError])
def test_what_fails_leaves_the_file_as_it_was(tmp_path: Path, failure: type[BaseException]) -> None:
    path = tmp_path / "a.csv"
    path.write_text("before")
    with pytest.raises(failure), atomic_file(path, ConfigError) as file:
        file.write(b"half")
        raise failure
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_file_and_folder_are_flushed_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this order: content, new name, folder."""
    steps: list[str] = []
    sync, rename = os.fsync, Path.replace

    def seen_sync(descriptor: int) -> None:
        steps.append("folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file")
        sync(descriptor)

    def seen_rename(here: Path, there: Path) -> Path:
        steps.append("rename")
        return rename(here, there)

    monkeypatch.setattr(os, "fsync", seen_sync)
    monkeypatch.setattr(Path, "replace", seen_rename)
    write_atomically(tmp_path / "a", b"1", ConfigError)
    assert steps == ["file", "rename", "folder"]
    steps.clear()
    write_atomically(tmp_path / "a", b"2", ConfigError, sync_folder=False)
    assert steps == ["file", "rename"]


def test_a_link_keeps_pointing_to_what_is_replaced(tmp_path: Path) -> None:
    target, link = tmp_path / "there" / "target", tmp_path / "link"
    target.parent.mkdir()
    link.symlink_to(target)
    write_atomically(link, b"new", ConfigError)  # the target does not exist yet
    write_atomically(link, b"newer", ConfigError)
    assert link.is_symlink()
    assert target.read_bytes() == b"newer"
    assert list(target.parent.iterdir()) == [target]


def test_a_device_is_written_and_stays_a_device(tmp_path: Path) -> None:
    link = tmp_path / "out"
    link.symlink_to(FULL)
    for path in (FULL, link):
        with pytest.raises(DatasetError, match=f"{path} cannot be written: no space left on the disk; give"):
            write_atomically(path, b"x", DatasetError)
    assert stat.S_ISCHR(FULL.stat().st_mode)
    assert link.is_symlink()
    write_atomically(Path("/dev/null"), b"x", DatasetError)
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)


def test_a_named_pipe_gets_the_content(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_atomically(pipe, b"through", ConfigError)
    reader.join(timeout=10)
    assert got == [b"through"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.parametrize("path", ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
@pytest.mark.parametrize("is_file", [False, True], ids=["to a pipe", "to a file"])
def test_standard_output_by_every_name(tmp_path: Path, path: str, is_file: bool) -> None:
    code = (
        "from pathlib import Path; from palpate_edge.common.errors import ConfigError\n"
        "from palpate_edge.common.atomic_write import write_atomically\n"
        f"write_atomically(Path({path!r}), b'content', ConfigError)"
    )
    command = [sys.executable, "-c", code]
    if not is_file:
        assert subprocess.run(command, check=True, capture_output=True, cwd=tmp_path).stdout == b"content"
    else:
        out = tmp_path / "out"
        with out.open("wb") as file:
            subprocess.run(command, check=True, stdout=file, cwd=tmp_path)
        assert out.read_bytes() == b"content"
        assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize(
    ("place", "reason"),
    [
        ("nowhere/a", "its folder does not exist"),
        ("file/a", "a part of its path is a file"),
        ("folder", "is a folder"),
    ],
)
def test_a_refusal_names_the_path_and_the_reason(tmp_path: Path, place: str, reason: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    before = set(tmp_path.rglob("*"))
    for write in (write_atomically, _by_path):
        with pytest.raises(ConfigError) as caught:
            write(tmp_path / place, b"x", ConfigError)
        assert str(caught.value) == f"{tmp_path / place} cannot be written: {reason}; give another path"
    assert set(tmp_path.rglob("*")) == before


def _by_path(path: Path, data: bytes, error: type[ConfigError]) -> None:
    with atomic_path(path, error) as temporary:
        temporary.write_bytes(data)


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    make_folder(tmp_path / "a" / "b", ConfigError)
    make_folder(tmp_path / "a" / "b", ConfigError)
    for path, reason in (("file", "is a file"), ("file/b", "a part of its path is a file")):
        with pytest.raises(ConfigError, match=f"folder {tmp_path / path} cannot be made: {reason}; give"):
            make_folder(tmp_path / path, ConfigError)
