"""A full disk, a folder that is missing and a path below a file are refused in one line by every command."""

from __future__ import annotations

import stat
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from palpate_host.config.packaged import MODELS

ROOT = Path(__file__).resolve().parents[2]
SENSOR = ROOT / "demo" / "recording" / "press" / "sensor.toml"
HAND = MODELS / "table4.toml"
LOG = ROOT / "tests" / "replay" / "normal.log.gz"
NO_SPACE = "no space left on the disk"
NO_FOLDER = "its folder does not exist"
BELOW_A_FILE = "a part of its path is a file"


@pytest.fixture(params=["full", "nowhere", "file"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[str], tuple[Path, str]]:
    """Gives a path of this name that cannot be written, and the reason."""

    def make(name: str) -> tuple[Path, str]:
        if request.param == "full":  # a link, so that the name may have an ending
            path = tmp_path / name
            path.symlink_to("/dev/full")
            return path, NO_SPACE
        if request.param == "nowhere":
            return tmp_path / "nowhere" / name, NO_FOLDER
        (tmp_path / "taken").touch()
        return tmp_path / "taken" / name, BELOW_A_FILE

    return make


def test_the_fingertips_files(
    refused: Callable[..., str],
    place: Callable[[str], tuple[Path, str]],
    drawn_dataset: Path,
    drawn_calibration_file: Path,
) -> None:
    calibration = ("--calibration", drawn_calibration_file)
    frame = drawn_dataset / "reference" / "0.png"
    for name, command in {
        "a.cal": ("calibrate", drawn_dataset, "--no-model", "-o"),
        "a.csv": ("estimate", drawn_dataset / "reference", *calibration, "--csv"),
        "beads.png": ("inspect", frame, "-o"),
        "steps.png": ("inspect", frame, *calibration, "-o"),
        "tracks.png": ("follow", drawn_dataset, "-o"),
    }.items():
        path, reason = place(name)
        assert refused(*command, path) == f"{path} cannot be written: {reason}; give another path"
    assert stat.S_ISCHR(Path("/dev/full").stat().st_mode)


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("sensor.svg", ("simulate", "sensor", SENSOR, "--picture")),
        ("hand.png", ("check", "--config", HAND, "--offline", "--picture")),
        ("hand.xml", ("simulate", "hand", "--hand", "table4", "--write")),
        ("board.png", ("groundtruth", "board", "-o")),
        ("hand.rrd", ("view", LOG, "--config", HAND, "--save")),
        ("hand.csv", ("export", LOG, "--config", HAND, "-o")),
        ("hand.parquet", ("export", LOG, "--config", HAND, "-o")),
        ("hand.mcap", ("export", LOG, "--config", HAND, "-o")),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(map(str, value[:2])),
)
def test_the_hosts_files(
    host_refused: Callable[..., str],
    place: Callable[[str], tuple[Path, str]],
    name: str,
    command: tuple[object, ...],
) -> None:
    path, reason = place(name)
    assert host_refused(*command, path) == f"{path} cannot be written: {reason}; give another path"


@pytest.mark.parametrize(
    "command",
    [
        ("demo", "--lockstep", "--output"),
        ("experiment", "-o"),
        ("simulate", "paper", "-o"),
        ("simulate", "loop", "--direct", "-o"),
        ("simulate", "shake", "-o"),
        ("simulate", "fingertips", "-o"),
    ],
    ids=lambda command: " ".join(map(str, command[:2])),
)
def test_folders_below_a_file(
    host_refused: Callable[..., str], tmp_path: Path, command: tuple[object, ...]
) -> None:
    (tmp_path / "taken").touch()
    text = host_refused(*command, tmp_path / "taken" / "out")
    assert str(tmp_path / "taken" / "out") in text
    assert BELOW_A_FILE in text


@pytest.mark.parametrize("module", ["palpate_edge.cli.main", "palpate_host.cli.main"])
def test_standard_output_on_a_full_disk(module: str) -> None:
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", module, "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr == (
        "error: output cannot be written: no space left on the disk; free some space or give another path\n"
    )


def test_csv_and_json_on_standard_output(drawn_dataset: Path, drawn_calibration_file: Path) -> None:
    calibration = ("--calibration", drawn_calibration_file)
    for command, begins in (
        (("estimate", drawn_dataset / "reference", *calibration, "--csv", "-"), "frame,contact,x_mm,"),
        (("evaluate", drawn_dataset, *calibration, "--json", "-"), "{"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "palpate_edge.cli.main", *map(str, command)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith(begins)
        assert done.stdout.rstrip().endswith("}" if begins == "{" else "")
        assert "written" in done.stderr or "region 1" in done.stderr


@pytest.mark.parametrize(
    ("command", "begins"),
    [
        (("replay", LOG, "--config", HAND, "-o", "-"), "# palpate"),
        (("simulate", "hand", "--hand", "table4", "--write", "-"), "<mujoco"),
    ],
    ids=["replay", "simulate hand"],
)
def test_the_hosts_text_on_standard_output(command: tuple[object, ...], begins: str) -> None:
    """Nothing but the file's content is there; notes go to standard error."""
    done = subprocess.run(
        [sys.executable, "-m", "palpate_host.cli.main", *map(str, command)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(begins), done.stdout[:200]
    assert "frames out" not in done.stdout
    assert done.stderr
