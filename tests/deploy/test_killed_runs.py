"""site.yml killed (signal 9) after any of its tasks, on a board of today and on one of an earlier version.

One further run must end with the state of a run that was not killed (deploy_rig/card_state.py).
No run is killed after a task that reports no change and leaves the board as it was: the kill before it is the
same one. A run that is not killed measures that, by files and processes (callbacks/list_tasks.py).
PALPATE_KILLS is the number of kills, drawn by PALPATE_SEED; or "11-20", the 11th to the 20th of that draw, so
that the kills can be spread over several runs; or "all" (hours). The switch of releases is killed before each
of its steps.
"""

from __future__ import annotations

import itertools
import os
import random
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from deploy_rig.card_state import card_state, running_release
from deploy_rig.fingertip_board import FingertipBoard, SlowCamera, fingertip_board, release_of
from deploy_rig.image import changed_wheelhouse

pytestmark = pytest.mark.deploy_killed

KILLS, SEED = os.environ.get("PALPATE_KILLS", "5"), int(os.environ.get("PALPATE_SEED", "1"))
BEFORE = {"fingertip_node_id": 0x11, "base_ssh_passwords": True, "base_time_servers": ["192.0.2.1"]}
WANTED = {"fingertip_node_id": 0x10, "base_ssh_passwords": False, "base_time_servers": ["192.0.2.2"]}
# Every file that site.yml copies gets a further line, as if it were another version's.
AGE = (
    "find /etc /usr/local/sbin /opt/palpate/bin /opt/palpate/release-signers "
    "-type f -newer /root/.ssh/before \\( -path '*palpate*' -o -path '*/70-can0*' \\) -not -name '*.cal' | "
    "while read -r file; do echo '# of an earlier version' >>\"$file\"; done"
)
# The release that a rollback would activate.
PREVIOUS = (
    "cd /opt/palpate && release=$(basename $(readlink current)) && "
    "cp --archive --link releases/$release releases/previous && ln -s releases/previous previous"
)


@dataclass(frozen=True)
class Start:
    """A board before a run.

    tasks: those of a run that was not killed; state: the state after it; kills: the numbers, from 1, of tasks
    that report a change or left the board in another state than the task before.
    """

    name: str
    layers: tuple[Path, ...]
    tasks: tuple[str, ...]
    kills: tuple[int, ...]
    state: dict[str, str]


@dataclass(frozen=True)
class Case:
    """A kill after the task with this number, from 1."""

    start: Start
    number: int

    def __str__(self) -> str:
        tasks = self.start.tasks
        return f"{self.start.name}: {self.number} of {len(tasks)}, {tasks[self.number - 1]}"


@pytest.fixture(scope="module")
def newer(wheels: Path, bare_board: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheelhouse of another release."""
    folder, place = tmp_path_factory.mktemp("newer"), ("edge/palpate_edge/__init__.py", '"""palpate_edge:')
    return changed_wheelhouse(folder, wheels, bare_board / "key", *place, '"""palpate_edge :')


@pytest.fixture(scope="module")
def boot(
    bare_board: Path, newer: Path, slow_camera: SlowCamera, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Any]:
    """Boot a board over layers."""

    @contextmanager
    def booted(*layers: Path) -> Iterator[FingertipBoard]:
        folder = tmp_path_factory.mktemp("board")
        with fingertip_board(folder, bare_board / "key", newer, slow_camera, *layers) as board:
            yield board

    return booted


@pytest.fixture(scope="module")
def older(
    boot: Callable[..., Any],
    wheels: Path,
    packaged_card: tuple[Path, ...],
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, ...]:
    """The layers of a provisioned board of an earlier version."""
    cards = tmp_path_factory.mktemp("older")
    with boot(*packaged_card) as board:
        board.machine.run("touch", "/root/.ssh/before")
        board.play("site", release_wheelhouse=str(wheels), **BEFORE).well()
        board.machine.run("sh", "-c", AGE)
        board.machine.run("sh", "-c", PREVIOUS)
        return board.machine.keep_card(cards / "older"), *packaged_card


@pytest.fixture(scope="module")
def starts(
    boot: Callable[..., Any],
    older: tuple[Path, ...],
    packaged_card: tuple[Path, ...],
    tmp_path_factory: pytest.TempPathFactory,
) -> list[Start]:
    """A bare board with apt's packages, and a provisioned one of an earlier version."""
    cards = tmp_path_factory.mktemp("cards")
    layers = {"bare": packaged_card, "older": older}
    return [start(boot, name, *of_it, cards=cards) for name, of_it in layers.items()]


def start(boot: Callable[..., Any], name: str, *layers: Path, cards: Path) -> Start:
    """Run site.yml once from this start, for its tasks and the state afterwards."""
    tasks = cards / f"{name}.tasks"
    with boot(*layers) as board:
        board.play("site", listing=board.machine.listing(tasks), **WANTED).well()
        board.master.contact_after(time.monotonic())
        state = card_state(board)
    lines = [line.split(" ", 2) for line in tasks.read_text().splitlines()]
    names, changed = tuple(task for _, _, task in lines), [change == "changed" for _, change, _ in lines]
    steps = pairwise(["", *(digest for digest, _, _ in lines)])
    other = [said or before != after for said, (before, after) in zip(changed, steps, strict=True)]
    kills = tuple(number for number, kill in enumerate(other, 1) if kill)
    print(f"{name}: {len(names)} tasks ran, {sum(changed)} with a change; {len(kills)} kills stand for all")
    return Start(name, layers, names, kills, state)


def drawn(starts: list[Start]) -> list[Case]:
    """Return the kills of this run."""
    every = [Case(start, number) for start in starts for number in start.kills]
    random.Random(SEED).shuffle(every)
    if KILLS == "all":
        return every
    first, _, last = KILLS.rpartition("-")
    return every[int(first or 1) - 1 : int(last)]


def differences(board: FingertipBoard, case: Case) -> list[str]:
    """Return where a board differs from one whose run was not killed."""
    state, wanted = card_state(board), case.start.state
    names = sorted(state.keys() | wanted.keys())
    return [
        f"{name}: {state.get(name)}, not {wanted.get(name)}"
        for name in names
        if state.get(name) != wanted.get(name)
    ]


def kill_and_run_again(board: FingertipBoard, case: Case) -> str:
    """Return what is wrong afterwards, empty if nothing is."""
    killed = board.play("site", kill_after=case.number, **WANTED)
    assert killed.status == -signal.SIGKILL, killed.said
    again = board.play("site", **WANTED)
    links = board.machine.run(
        "readlink", "/opt/palpate/current", "/opt/palpate/previous", check=False
    ).split()
    if len(links) == 2 and links[0] == links[1]:
        return f"previous is current: {links[0]}"
    if again.status != 0:
        return f"error: {again.said[-2000:]}"
    board.master.contact_after(time.monotonic())
    return "; ".join(differences(board, case))


def test_a_run_killed_after_any_task_is_made_good_by_the_next(
    boot: Callable[..., Any], starts: list[Start], newer: Path
) -> None:
    assert all(start.state["running release"] == release_of(newer) for start in starts)
    cases, wrong = drawn(starts), []
    for done, case in enumerate(cases, 1):
        with boot(*case.start.layers) as board:
            fault = kill_and_run_again(board, case)
        print(f"{done} of {len(cases)}: {case}: {fault or 'good'}", flush=True)
        wrong += [f"{case}: {fault}"] if fault else []
    kills, tasks = sum(len(start.kills) for start in starts), sum(len(start.tasks) for start in starts)
    print(f"{len(cases)} of {kills} kills, which stand for {tasks} tasks (seed {SEED})")
    assert wrong == []


def test_a_switch_killed_before_any_of_its_steps_is_made_good_by_the_next(
    boot: Callable[..., Any], older: tuple[Path, ...]
) -> None:
    """To another release and back, killed one step later each time."""
    killer, switch = Path(__file__).parent / "deploy_rig/killed_switch.py", ("--interrupt", "switch")
    with boot(*older) as board:
        board.play("update").well()
        shutil.copy(killer, board.machine.outside)
        for step in itertools.count(1):
            old = board.serving()
            (new,) = set(board.machine.run("ls", "/opt/palpate/releases").split()) - {old}
            words = ("/usr/bin/python3", f"/run/outside/{killer.name}", str(step), *switch, new)
            status = board.machine.begin(*words).wait()
            if status == 0:
                break
            assert status in (-signal.SIGKILL, 128 + signal.SIGKILL)
            print(f"killed before step {step}: {board.serving()} is active", flush=True)
            board.machine.run("/opt/palpate/bin/palpate-release", *switch, new)
            previous = Path(board.machine.run("readlink", "/opt/palpate/previous")).name
            assert (board.serving(), previous, running_release(board)) == (new, old, new)
            assert board.machine.run("ls", "/opt/palpate/trial", check=False) == ""
        print(f"killed before each of {step - 1} steps")
        assert step > 10
