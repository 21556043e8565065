"""Files of the run folder, and configurations that are rejected before anything starts."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from palpate_edge.common.errors import ConfigError
from palpate_twin.demo.run_folder import LOCK, MODEL, locked_output, make_run_folder

RECORDING = Path(__file__).parents[3] / "demo" / "recording"


def test_the_hand_is_the_packaged_one_on_this_runs_bus(tmp_path):
    folder = make_run_folder(tmp_path / "run", RECORDING, 500_000)
    packaged, written = (tomllib.loads(path.read_text()) for path in (MODEL, folder.hand_toml))
    bus = {"interface": "palpate", "channel": str(folder.hub_socket), "bitrate": 500_000}
    staleness = packaged["staleness"] | {"lost_ms": 60_000}  # recorded presses leave the object
    run = packaged["run"] | {"start": "auto"}
    assert written == packaged | {"bus": bus, "run": run, "staleness": staleness}
    assert "geometry" in written  # no further model file is needed


def test_every_finger_plays_its_recording_on_its_node(tmp_path):
    folder = make_run_folder(tmp_path / "run", RECORDING, 1_000_000)
    for finger, config in zip(folder.hand().fingers, folder.fingertips(), strict=True):
        assert (config.name, config.node.id) == (finger.name, finger.fingertip_node)
        assert Path(config.capture.path) == RECORDING / finger.name
        assert config.capture.loop
        assert config.estimator.calibration == str(folder.calibration)
        assert config.bus == folder.hand().bus


def test_a_folder_with_quotes_and_spaces(tmp_path):
    folder = make_run_folder(tmp_path / 'a "run" \\ é', RECORDING, 1_000_000)
    assert folder.fingertips()[0].bus.channel == str(folder.hub_socket)


def test_the_last_run_is_gone(tmp_path):
    old = tmp_path / "run" / "bus.log"
    old.parent.mkdir()
    old.write_text("of the last run\n")
    make_run_folder(tmp_path / "run", RECORDING, 1_000_000)
    assert not old.exists()


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"press/sensor.toml: no such file: --recording needs"):
        make_run_folder(tmp_path / "run", tmp_path, 1_000_000)


def test_a_path_too_long_for_a_socket_is_refused_before_anything_is_made(tmp_path):
    path = tmp_path / ("x" * 108)
    with pytest.raises(ConfigError, match=r"path too long .* give a shorter --output"):
        make_run_folder(path, RECORDING, 1_000_000)
    assert not path.exists()


def test_with_the_twin_every_finger_sees_its_ring_in_memory(tmp_path):
    folder = make_run_folder(tmp_path / "run", None, 1_000_000)
    rings = [Path(config.capture.path) for config in folder.fingertips()]
    assert [config.capture.source for config in folder.fingertips()] == ["shared_memory"] * 3
    assert len({*rings, folder.ring("finger-1")}) == 3
    other = make_run_folder(tmp_path / "other", None, 1_000_000)
    assert not {other.ring(finger.name) for finger in other.hand().fingers} & {*rings}


def test_with_the_twin_the_hand_differs_where_the_docs_say(tmp_path):
    folder = make_run_folder(tmp_path / "run", None, 1_000_000)
    packaged, written = (tomllib.loads(path.read_text()) for path in (MODEL, folder.hand_toml))
    control = {"law": "pose"}
    assert written["control"] == packaged["control"] | control
    assert (written["staleness"], written["network"]) == (packaged["staleness"], packaged["network"])
    assert written["target"]["rpy_deg"] == [30.0, 0.0, 0.0]
    assert written["twin"]["start_pose_rad"] == [0.0, 0.06, 1.509]
    assert written["twin"]["object"] == packaged["twin"]["object"]
    pushes = [(one["start_s"], one["duration_s"], one["force_N"]) for one in written["twin"]["disturbances"]]
    assert pushes == [(7.6, 0.2, [0.0, 0.0, -2.0]), (15.6, 0.2, [2.0, 0.0, 0.0])]


def test_packaged_hands_do_not_move_by_themselves() -> None:
    """A person copies them: a hand moves after a command, or where its file or --start says auto."""
    for path in sorted(MODEL.parent.glob("table*.toml")):
        table = tomllib.loads(path.read_text())
        if "target" in table and path.name != "table3.toml":  # which is of the simulation alone
            assert table["run"]["start"] == "command", path.name


def test_one_demo_at_a_time_in_a_folder(tmp_path: Path) -> None:
    output = tmp_path / "demo"
    holder = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import sys; from pathlib import Path; from palpate_twin.demo.run_folder import locked_output\n"
            "with locked_output(Path(sys.argv[1])):\n"
            "    print('locked', flush=True)\n"
            "    sys.stdin.read()",
            str(output),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "locked\n"
    (output / "run").mkdir()
    refused = subprocess.run(
        [sys.executable, "-m", "palpate_host.cli.main", "demo", "--lockstep", "--output", str(output)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert refused.returncode == 2
    assert refused.stderr == (
        f"error: {output}: another demo runs there (pid {holder.pid}): wait, or give another --output\n"
    )
    assert (output / "run").is_dir()
    holder.kill()  # even so, the folder is free afterwards
    holder.communicate()
    with locked_output(output):
        assert (output / LOCK).read_text() == f"{os.getpid()}\n"
        with (output / LOCK).open() as again, pytest.raises(BlockingIOError):
            fcntl.flock(again, fcntl.LOCK_EX | fcntl.LOCK_NB)
