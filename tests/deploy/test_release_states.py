"""The switch of releases with a power cut, or a kill, before every change of the card.

The files are real; the services are a stand-in, in which one release is dead. test_namespace_board.py has
systemd.
"""

from __future__ import annotations

import importlib.util
import itertools
import os
import random
import time
from pathlib import Path
from types import ModuleType

import pytest

from deploy_rig.image import ANSIBLE

SCRIPT = ANSIBLE / "roles/release/files/palpate_release.py"
SERVICE = "palpate-fingertip.service"
DEAD = "dead"


class PowerCutError(BaseException):
    """No handler of the program may catch it."""


class Board:
    """A card with releases a, b and dead, and the release that the service runs."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.program = load()
        self.running = ""
        self.steps_left = 10**9
        program = self.program
        for name, path in (
            ("BASE", ""),
            ("CURRENT", "current"),
            ("PREVIOUS", "previous"),
            ("TRIAL", "trial"),
        ):
            monkeypatch.setattr(program, name, folder / path)
        for release in ("a", "b", "c", DEAD):
            (folder / "releases" / release).mkdir(parents=True)
            (folder / "releases" / release / ".complete").touch()
        monkeypatch.setattr(program, "enabled", lambda: [SERVICE])
        monkeypatch.setattr(program, "restart", self.restart)
        monkeypatch.setattr(program, "state", lambda: {SERVICE: self.failing(self.running)})
        monkeypatch.setattr(program, "main_pid", lambda _: 1 if self.running else 0)
        monkeypatch.setattr(program, "stale", self.stale)
        monkeypatch.setattr(program, "unhealthy", self.unhealthy)
        for name in ("rename", "unlink", "symlink_to"):
            self.count(monkeypatch, name)

    def count(self, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
        """Cut the power before a change of the card, when no step is left."""
        real = getattr(Path, name)

        def changed(path: Path, *words: object, **options: object) -> object:
            self.step()
            return real(path, *words, **options)

        monkeypatch.setattr(Path, name, changed)

    def step(self) -> None:
        if self.steps_left == 0:
            raise PowerCutError
        self.steps_left -= 1
        assert not self.program.target(self.program.CURRENT) or (
            self.program.target(self.program.CURRENT) != self.program.target(self.program.PREVIOUS)
        ), "previous is current"

    def restart(self, _services: list[str]) -> None:
        self.step()
        self.running = self.current

    def failing(self, release: str) -> set[str]:
        return {"beads"} if release == DEAD else set()

    def stale(self, _service: str, release: str) -> str:
        return "" if self.running == release else "another release"

    def unhealthy(self, wanted: dict[str, set[str]], _patience_s: float, release: str) -> str:
        self.step()
        worse = self.failing(self.running) - wanted[SERVICE]
        return f"fails in {worse}" if worse or self.running != release else ""

    def power_cut(self) -> None:
        """The board starts again, as palpate-settle.service and the services do."""
        if self.program.TRIAL.exists():
            self.program.settle()
        self.running = self.current

    def switch(self, release: str, then: str | None = None) -> bool:
        """Return whether the switch ended with success; an error is no success."""
        try:
            self.program.switch(release, 1.0, then=then)
        except SystemExit:
            return False
        return True

    def cut(self, release: str, steps: int, then: str | None = None) -> bool:
        """Switch with a cut after some steps; return whether it came to that."""
        self.steps_left = steps
        try:
            self.switch(release, then)
        except PowerCutError:
            return True
        finally:
            self.steps_left = 10**9
        return False

    @property
    def current(self) -> str:
        return str(self.program.target(self.program.CURRENT))

    @property
    def previous(self) -> str:
        return str(self.program.target(self.program.PREVIOUS))


def load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("palpate_release", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Board:
    """Release a serves, b is the previous one."""
    board = Board(tmp_path, monkeypatch)
    assert board.switch("b")
    assert board.switch("a")
    assert (board.current, board.previous, board.running) == ("a", "b", "a")
    return board


def test_a_failed_update_keeps_the_release_to_roll_back_to(board: Board) -> None:
    assert not board.switch(DEAD)
    assert (board.current, board.previous, board.running) == ("a", "b", "a")


@pytest.mark.parametrize("then", ["power cut", "kill"])
@pytest.mark.parametrize("release", ["b", DEAD])
def test_a_cut_at_any_step_ends_with_one_proven_release(board: Board, release: str, then: str) -> None:
    """b is the previous release as well, dead a new one; each cut is followed by the same update again."""
    for steps in itertools.count():
        was_cut = board.cut(release, steps)
        if was_cut and then == "power cut":
            board.power_cut()
            assert board.current in {"a", release} - {DEAD}
            assert not board.program.TRIAL.exists()
        succeeded = board.switch(release)
        assert succeeded == (release != DEAD)
        assert board.running == board.current == ("a" if release == DEAD else release)
        assert board.previous == ("b" if release == DEAD else "a")
        if release == "b":
            board.switch("a")
        if not was_cut:
            print(f"{steps} steps")
            assert steps > 5
            return


def test_a_kill_during_a_trial_never_blesses_the_dead_release(board: Board) -> None:
    """The next update finds the dead release running: its failing parts are no baseline."""
    for steps in itertools.count():
        if not board.cut(DEAD, steps):
            return
        assert not board.switch(DEAD)
        assert (board.current, board.running) == ("a", "a")


def test_200_random_cuts_and_kills(board: Board) -> None:
    rng = random.Random(1)
    for _ in range(200):
        release = rng.choice(["a", "b", DEAD])
        if board.cut(release, rng.randrange(12)) and rng.random() < 0.5:
            board.power_cut()
            assert board.current in ("a", "b")
            assert board.running == board.current
        if board.switch(release):
            assert board.running == board.current == release != DEAD
        else:
            assert release == DEAD
            assert board.running == board.current != DEAD
        assert board.previous != board.current


def test_a_rollback_during_a_trial_returns_to_the_old_release(board: Board) -> None:
    assert board.cut(DEAD, 8)
    assert board.program.TRIAL.exists()
    board.program.rollback(1.0)
    assert (board.current, board.previous, board.running) == ("a", "b", "a")


@pytest.mark.parametrize("then", ["power cut", "kill"])
@pytest.mark.parametrize("previous", ["c", ""])
def test_a_hand_that_returns_has_the_previous_release_of_before(
    board: Board, previous: str, then: str
) -> None:
    """a and c (or none) were there, b was switched to; another board failed, so this one returns, cut at any
    step."""
    for steps in itertools.count():
        board.program.remove(board.program.PREVIOUS)
        board.program.point(board.program.CURRENT, "b")
        board.program.point(board.program.PREVIOUS, "a")
        board.running = "b"
        was_cut = board.cut("a", steps, previous)
        if was_cut and then == "power cut":
            board.power_cut()
            assert board.current in ("a", "b")
        assert board.switch("a", previous)
        assert (board.current, board.previous, board.running) == ("a", previous, "a")
        if not was_cut:
            assert steps > 5
            return


@pytest.mark.parametrize(
    ("nmt_state", "age_s", "words"),
    [("operational", 0.0, "OPERATIONAL"), ("operational", 60.0, ""), ("pre-operational", 0.0, "")],
)
def test_a_fingertip_that_a_hand_needs_is_not_restarted_unasked(
    board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, nmt_state: str, age_s: float, words: str
) -> None:
    """A report of a minute ago is of a process that is gone."""
    report = tmp_path / "palpate-finger-1.json"
    report.write_text(f'{{"nmt_state": "{nmt_state}"}}')
    os.utime(report, (time.time() - age_s,) * 2)
    monkeypatch.setattr(board.program, "HEALTH", tmp_path)
    if words:
        with pytest.raises(SystemExit, match=words):
            board.program.switch("b", 1.0)
        assert (board.current, board.running, board.program.TRIAL.exists()) == ("a", "a", False)
    board.program.switch("b", 1.0, interrupt=bool(words))
    assert (board.current, board.previous, board.running) == ("b", "a", "b")


@pytest.mark.parametrize("current", ["a", "b"])
def test_a_trial_of_an_earlier_version_is_ended(board: Board, current: str) -> None:
    """Such a trial notes only the new release's name; `previous` is the old release."""
    board.program.remove(board.program.PREVIOUS)
    board.program.point(board.program.CURRENT, current)
    if current == "b":
        board.program.point(board.program.PREVIOUS, "a")
    board.program.TRIAL.write_text("b")
    board.power_cut()
    assert (board.current, board.previous) == ("a", "")


def test_the_first_release_that_is_dead_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    board = Board(tmp_path, monkeypatch)
    monkeypatch.setattr(board.program, "unhealthy", lambda *_: "is failed")
    assert not board.switch(DEAD)
    board.running = ""
    assert not board.switch(DEAD)
    assert board.previous == ""
