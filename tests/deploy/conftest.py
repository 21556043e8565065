"""Fixtures shared by the tiers."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from deploy_rig.fingertip_board import SlowCamera, fingertip_board
from deploy_rig.fingertip_board import slow_camera as slowed
from deploy_rig.image import SUITES, board_image, missing, wheelhouse


@pytest.fixture(scope="session")
def suite() -> str:
    """Debian's suite on the boards: PALPATE_SUITE, bookworm (Debian 12) unless it is set."""
    name = os.environ.get("PALPATE_SUITE", "bookworm")
    assert name in SUITES, f"PALPATE_SUITE={name} is not one of {', '.join(SUITES)}"
    return name


@pytest.fixture(scope="session")
def python(suite: str) -> str:
    """The version of the boards' Python."""
    return SUITES[suite]


@pytest.fixture(scope="session")
def bare_board(suite: str) -> Path:
    """The folder of a bare Debian board."""
    if (reason := missing()) is not None:
        pytest.skip(reason)
    return board_image(suite)


@pytest.fixture(scope="session")
def wheels(bare_board: Path, python: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheelhouse of a fingertip with today's sources."""
    return wheelhouse(tmp_path_factory.mktemp("wheels") / "wheelhouse", python=python, key=bare_board / "key")


@pytest.fixture(scope="session")
def slow_camera(drawn_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> SlowCamera:
    """The drawn dataset at 10 frames a second, with its calibration."""
    return slowed(drawn_dataset, tmp_path_factory.mktemp("slow"))


@pytest.fixture(scope="session")
def packaged_card(
    bare_board: Path, slow_camera: SlowCamera, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, ...]:
    """The layers of a card on which site.yml was killed after its first change: Debian and apt's packages."""
    folder = tmp_path_factory.mktemp("packaged")
    tree, key = bare_board / "tree", bare_board / "key"
    with fingertip_board(folder, key, folder / "none", slow_camera, tree) as board:
        killed = board.play("site", kill_after="Install packages with apt")
        assert killed.status == -signal.SIGKILL, killed.said
        return board.machine.keep_card(folder / "card"), tree
