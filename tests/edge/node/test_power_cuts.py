"""The power goes at every step of a save: what is read afterwards is the last save or the one before."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.parameter_file import Disk, ParameterFile
from palpate_edge.node.stored_parameters import NOTHING_STORED, StoredParameters

CUTS = 1_000
STEPS_OF_A_SAVE = 7


class PowerCutError(Exception):
    """Nothing runs any more."""


class FailingDisk(Disk):
    """A real folder whose power goes at operation number `cut_at`.

    What was written and not flushed is lost in part: a file keeps any beginning of its bytes, or noise of its
    length; a name that was replaced since the folder was flushed may be the old one again, the last first.
    """

    def __init__(self, rng: random.Random, cut_at: int | None) -> None:
        self._rng = rng
        self._cut_at = cut_at
        self._operations = 0
        self._unflushed: set[Path] = set()
        self._renames: list[tuple[Path, Path, bytes, bytes | None]] = []

    def read(self, path: Path) -> bytes:
        self._step()
        return super().read(path)

    def write(self, path: Path, content: bytes) -> None:
        self._unflushed.add(path)
        super().write(path, content)
        self._step()

    def flush(self, path: Path) -> None:
        self._step()
        super().flush(path)
        self._unflushed.discard(path)
        if path.is_dir():
            self._renames.clear()

    def replace(self, path: Path, target: Path) -> None:
        self._step()
        before = target.read_bytes() if target.exists() else None
        self._renames.append((path, target, path.read_bytes(), before))
        super().replace(path, target)

    def _step(self) -> None:
        self._operations += 1
        if self._operations == self._cut_at:
            self._lose_power()
            raise PowerCutError

    def _lose_power(self) -> None:
        for source, target, moved, before in reversed(self._renames):
            if self._rng.random() < 0.5:
                break
            source.write_bytes(moved)
            if before is None:
                target.unlink()
            else:
                target.write_bytes(before)
        for path in self._unflushed:
            content = path.read_bytes()
            torn = content[: self._rng.randrange(len(content) + 1)]
            path.write_bytes(self._rng.choice([torn, self._rng.randbytes(len(content)), bytes(len(content))]))


def numbered(number: int) -> StoredParameters:
    """Parameters whose length varies."""
    return StoredParameters("0123456789abcdef", 1 + number % 127, None, {(0x2003, 0): "x" * (number % 60)})


@pytest.mark.parametrize("seed", range(4))
def test_a_save_is_whole_or_was_not(tmp_path: Path, seed: int) -> None:
    """One board through a quarter of the cuts, each at a random step, with 0 to 2 good saves between."""
    rng = random.Random(seed)
    path = tmp_path / "parameters"
    safe, number = NOTHING_STORED, 0
    steps_cut: list[int] = []
    while len(steps_cut) < CUTS // 4:
        for _ in range(rng.randrange(3)):
            number += 1
            safe = numbered(number)
            ParameterFile(path, FailingDisk(rng, None)).save(safe)
        number += 1
        step = rng.randint(1, STEPS_OF_A_SAVE)
        try:
            ParameterFile(path, FailingDisk(rng, step)).save(numbered(number))
        except PowerCutError:
            steps_cut.append(step)
        else:
            safe = numbered(number)  # without an old file to keep, a save has a step less
        read = ParameterFile(path).load()
        assert read in (safe, numbered(number))
        safe = read
    assert set(steps_cut) == set(range(1, STEPS_OF_A_SAVE + 1))


@pytest.mark.parametrize("step", range(1, STEPS_OF_A_SAVE))
def test_the_first_save_of_all(tmp_path: Path, step: int) -> None:
    """Nothing to fall back to: after the cut there is nothing, or all of it."""
    for seed in range(20):
        folder = tmp_path / str(seed)
        folder.mkdir()
        with pytest.raises(PowerCutError):
            ParameterFile(folder / "parameters", FailingDisk(random.Random(seed), step)).save(numbered(1))
        assert ParameterFile(folder / "parameters").load() in (NOTHING_STORED, numbered(1))


def test_a_disk_that_reads_back_something_else_keeps_the_old_save(tmp_path: Path) -> None:
    class Forgetful(Disk):
        def write(self, path: Path, content: bytes) -> None:
            super().write(path, content[:-1])

    path = tmp_path / "parameters"
    ParameterFile(path).save(numbered(1))
    with pytest.raises(ConfigError, match="reads back differently"):
        ParameterFile(path, Forgetful()).save(numbered(2))
    assert ParameterFile(path).load() == numbered(1)
