"""A LeRobot dataset of recorded runs, read back as LeRobot's loaders read it.

Expected are the paths, keys and types of huggingface/lerobot, src/lerobot/datasets (format v3.0):
`DatasetInfo`, `load_tasks` (the index of a pandas frame), `load_episodes`, `get_hf_features_from_features`,
`compute_episode_stats`.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from palpate_host.cli.main import cli
from palpate_host.common.status import HostStatus
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

PROJECT = Path(__file__).resolve().parents[3]
LOG = PROJECT / "tests" / "replay" / "virtual.log.gz"
HAND = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
FPS = 50
KEY = "observation.images.finger-1"
STATISTICS = {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}


@pytest.fixture(scope="module")
def statuses() -> list[HostStatus]:
    return list(read_statuses(LOG, *load_hand(HAND)))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory, statuses: list[HostStatus]) -> Path:
    """A recording of 20 grey pictures, each brighter than the last, 0.1 s apart from the first tick on."""
    folder = tmp_path_factory.mktemp("pictures")
    lines = ["frame,exposed_at_us,sequence"]
    for number in range(20):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((48, 64, 3), 10 * number + 20, np.uint8))
        lines.append(f"{number}.png,{statuses[0].time_us + 100_000 * number},{number}")
    (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory, pictures: Path) -> Path:
    folder = tmp_path_factory.mktemp("lerobot") / "set"
    arguments = ["lerobot", LOG, LOG, "--config", HAND, "-o", folder, "--task", "Turn it.", "--fps", FPS]
    done = CliRunner().invoke(cli, [*map(str, arguments), "--camera", f"finger-1={pictures}"])
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope="module")
def info(dataset: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((dataset / "meta/info.json").read_text())
    return found


@pytest.fixture(scope="module")
def data(dataset: Path) -> pa.Table:
    return pq.read_table(dataset / "data/chunk-000/file-000.parquet")


def test_info_describes_the_data(info: dict[str, Any], data: pa.Table) -> None:
    assert info["codebase_version"] == "v3.0" and info["robot_type"] == "palpate_hand"
    assert info["fps"] == FPS and info["splits"] == {"train": "0:2"}
    assert (info["total_episodes"], info["total_tasks"], info["total_frames"]) == (2, 1, data.num_rows)
    assert info["data_path"] == "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    assert info["video_path"] == "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
    stored = {key: feature for key, feature in info["features"].items() if feature["dtype"] != "video"}
    assert set(stored) == set(data.column_names)
    for key, feature in stored.items():
        kind, (size,) = data.schema.field(key).type, feature["shape"]
        value_type = kind.value_type if size > 1 else kind
        assert size == 1 or kind.list_size == size == len(feature["names"])
        assert str(value_type) == {"float32": "float", "int64": "int64"}[feature["dtype"]]
    assert info["features"]["observation.tactile.finger-2"]["names"] == [
        *("x_mm", "y_mm", "z_mm", "fn_N", "fx_N", "fy_N", "in_contact", "slip")
    ]
    assert info["features"][KEY]["shape"] == [48, 64, 3]


def test_frames_are_the_newest_ticks_at_exact_times(data: pa.Table, statuses: list[HostStatus]) -> None:
    """The episode begins with the first tick in which every joint has a position and a command."""
    whole = [
        status
        for status in statuses
        if all(joint.position_rad is not None and joint.command_Nm is not None for joint in status.joints)
    ]
    count = data.num_rows // 2
    assert count == (whole[-1].time_us - whole[0].time_us) * FPS // 1_000_000 + 1
    rows = data.to_pylist()
    assert [row["index"] for row in rows] == list(range(2 * count))
    assert [row["frame_index"] for row in rows] == [*range(count), *range(count)]
    assert [row["episode_index"] for row in rows] == [0] * count + [1] * count
    for row in rows:
        assert (
            row["timestamp"] == pytest.approx(row["frame_index"] / FPS, rel=1e-6) and row["task_index"] == 0
        )
        status = whole[2 * row["frame_index"]]  # ticks at 100 Hz
        assert row["action"] == pytest.approx([joint.command_Nm for joint in status.joints], rel=1e-6)
        assert row["observation.state"] == pytest.approx([j.position_rad for j in status.joints], rel=1e-6)
        finger = status.fingers[1]
        tactile = row["observation.tactile.finger-2"]
        assert tactile[6] == float(finger.valid and finger.in_contact)
        assert tactile[3] == pytest.approx(finger.normal_force_N or 0.0)
        assert np.isfinite(tactile).all()


def test_an_episode_is_a_row_group_and_a_row_of_the_episodes(dataset: Path, data: pa.Table) -> None:
    count = data.num_rows // 2
    assert pq.ParquetFile(dataset / "data/chunk-000/file-000.parquet").num_row_groups == 2
    first, second = pq.read_table(dataset / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    for number, row in enumerate((first, second)):
        assert (row["episode_index"], row["length"], row["tasks"]) == (number, count, ["Turn it."])
        assert (row["dataset_from_index"], row["dataset_to_index"]) == (number * count, (number + 1) * count)
        files = ("data", f"videos/{KEY}", "meta/episodes")
        assert [row[f"{part}/{what}_index"] for part in files for what in ("chunk", "file")] == [0] * 6
        assert row[f"videos/{KEY}/from_timestamp"] == pytest.approx(number * count / FPS)
        assert row[f"videos/{KEY}/to_timestamp"] == pytest.approx((number + 1) * count / FPS)
        assert {key.rpartition("/")[2] for key in row if key.startswith("stats/action/")} == STATISTICS


def test_statistics_are_those_of_the_columns(dataset: Path, data: pa.Table, info: dict[str, Any]) -> None:
    stats = json.loads((dataset / "meta/stats.json").read_text())
    assert set(stats) == set(info["features"])
    action = np.array(data.column("action").to_pylist(), dtype=np.float64)
    assert stats["action"]["mean"] == pytest.approx(action.mean(axis=0).tolist())
    assert stats["action"]["std"] == pytest.approx(action.std(axis=0).tolist())
    assert stats["action"]["q90"] == pytest.approx(np.quantile(action, 0.9, axis=0).tolist())
    assert stats["action"]["count"] == [data.num_rows]
    for name in STATISTICS - {"count"}:
        assert np.array(stats[KEY][name]).shape == (3, 1, 1)
        assert np.min(stats[KEY][name]) >= 0 and np.max(stats[KEY][name]) <= 1


def test_tasks_are_the_index_of_a_pandas_frame(dataset: Path) -> None:
    """LeRobot reads tasks.parquet with pandas and takes a task by the frame's index."""
    table = pq.read_table(dataset / "meta/tasks.parquet")
    assert table.to_pydict() == {"task_index": [0], "task": ["Turn it."]}
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == ["task"]


def test_the_video_has_a_picture_for_each_frame(
    dataset: Path, data: pa.Table, statuses: list[HostStatus]
) -> None:
    """The brightness tells which picture it is: the newest one exposed before the frame."""
    video = cv2.VideoCapture(str(dataset / f"videos/{KEY}/chunk-000/file-000.mp4"))
    frames = []
    while (read := video.read())[0]:
        frames.append(float(read[1].mean()))
    assert len(frames) == data.num_rows and video.get(cv2.CAP_PROP_FPS) == FPS
    begin_us = next(
        status.time_us
        for status in statuses
        if all(
            None not in (j.position_rad, j.velocity_rad_s, j.torque_Nm, j.command_Nm) for j in status.joints
        )
    )
    for number, brightness in enumerate(frames):
        time_us = begin_us + number % (data.num_rows // 2) * 1_000_000 // FPS
        picture = min(19, (time_us - statuses[0].time_us) // 100_000)
        assert brightness == pytest.approx(10 * picture + 20, abs=4.9)  # MPEG-4 loses some


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--camera", "finger-1"), "write NAME=FOLDER"),
        (("--camera", "finger-1=nowhere"), "no index of recorded frames"),
    ],
)
def test_what_cannot_be_converted_is_named(
    tmp_path: Path, host_refused: Callable[..., str], options: tuple[str, ...], message: str
) -> None:
    arguments = ("lerobot", LOG, "--config", HAND, "-o", tmp_path / "set", "--task", "x")
    assert message in host_refused(*arguments, *options)


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path, host_refused: Callable[..., str]) -> None:
    (tmp_path / "x").touch()
    said = host_refused("lerobot", LOG, "--config", HAND, "-o", tmp_path, "--task", "x")
    assert "is not empty" in said
