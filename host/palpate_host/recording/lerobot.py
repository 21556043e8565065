"""A LeRobot dataset on disk, format v3.0, from the statuses of recorded runs: one episode a run.

Source of the format: github.com/huggingface/lerobot, folder src/lerobot/datasets, CODEBASE_VERSION v3.0.
Written are meta/info.json, meta/stats.json, meta/tasks.parquet, meta/episodes, data and videos, each in its
first chunk and file.

LeRobot needs a value in every frame and frames at exact multiples of 1/fps. Frames are the newest tick at
those times; an episode begins when every joint is known and commanded, and ends where that stops. Without
contact the tactile values are 0, and their element `in_contact` is 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from palpate_edge.common.arrays import Array
from palpate_edge.common.atomic_write import make_folder, refused_as, write_atomically
from palpate_edge.common.contact_quantities import QUANTITIES
from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import FingerStatus, HostStatus

VERSION = "v3.0"
ROBOT_TYPE = "palpate_hand"
FIRST = "chunk-000/file-000"
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
INDICES = ("frame_index", "episode_index", "index", "task_index")
TACTILE = tuple(quantity for quantity in QUANTITIES if quantity.in_tactile_vector)
FLAGS = ("in_contact", "slip")

Stats = dict[str, list[Any]]


@dataclass(frozen=True, slots=True)
class Episode:
    """One run. times_us (n,): of its frames; columns: (n, elements) by feature; task: what was done."""

    times_us: Array
    columns: Mapping[str, Array]
    task: str


@dataclass(frozen=True, slots=True)
class VideoFeature:
    """One camera's video over all episodes. shape: height, width, channels; stats: one for each episode, then
    of all; info: the codec as LeRobot describes it."""

    key: str
    shape: tuple[int, int, int]
    episode_stats: Sequence[Stats] = ()
    whole_stats: Stats = field(default_factory=dict)
    info: Mapping[str, Any] = field(default_factory=dict)


def episode_of(statuses: Iterable[HostStatus], fps: int, task: str) -> Episode:
    """Return the frames of a run. Raises ConfigError when no tick has every joint's position and command."""
    known: list[HostStatus] = []
    for status in statuses:
        if _is_whole(status):
            known.append(status)
        elif known:
            break
    if not known:
        raise ConfigError(
            "no tick has positions and commands of every joint: give a log of a run from its start"
        )
    ticks_us = np.array([status.time_us for status in known], dtype=np.int64)
    count = int((ticks_us[-1] - ticks_us[0]) * fps // 1_000_000) + 1
    times_us = ticks_us[0] + np.arange(count) * 1_000_000 // fps
    chosen = np.searchsorted(ticks_us, times_us, side="right") - 1
    rows = [_row(known[index]) for index in chosen]
    columns = {key: np.array([row[key] for row in rows], dtype=np.float64) for key in rows[0]}
    return Episode(times_us, columns, task)


def _is_whole(status: HostStatus) -> bool:
    return all(
        value is not None
        for joint in status.joints
        for value in (joint.position_rad, joint.velocity_rad_s, joint.torque_Nm, joint.command_Nm)
    )


def _row(status: HostStatus) -> dict[str, list[float]]:
    joints = status.joints
    row = {
        "observation.state": [joint.position_rad or 0.0 for joint in joints],
        "observation.velocity": [joint.velocity_rad_s or 0.0 for joint in joints],
        "observation.effort": [joint.torque_Nm or 0.0 for joint in joints],
        "action": [joint.command_Nm or 0.0 for joint in joints],
    }
    return row | {f"observation.tactile.{finger.name}": _tactile(finger) for finger in status.fingers}


def _tactile(finger: FingerStatus) -> list[float]:
    touches = finger.valid and finger.in_contact
    values = [quantity.of(finger) if touches else None for quantity in TACTILE]
    return [*(value or 0.0 for value in values), float(touches), float(touches and finger.slip)]


def names_of(status: HostStatus) -> dict[str, list[str]]:
    """Return the names of each feature's elements; position, torque and force have their units."""
    joints = [joint.name for joint in status.joints]
    tactile = [*(quantity.column for quantity in TACTILE), *FLAGS]
    return {
        "observation.state": [f"{name}.pos_rad" for name in joints],
        "observation.velocity": [f"{name}.vel_rad_s" for name in joints],
        "observation.effort": [f"{name}.torque_Nm" for name in joints],
        "action": [f"{name}.torque_Nm" for name in joints],
    } | {f"observation.tactile.{finger.name}": tactile for finger in status.fingers}


def write_dataset(
    folder: Path,
    episodes: Sequence[Episode],
    names: Mapping[str, Sequence[str]],
    fps: int,
    videos: Sequence[VideoFeature] = (),
) -> None:
    """Write everything but the video files into `folder`. Raises ConfigError when the file system refuses."""
    tasks = list(dict.fromkeys(episode.task for episode in episodes))
    tables = _tables(episodes, tasks, fps)
    data = pa.concat_tables(tables)
    features: dict[str, Any] = {
        key: {"dtype": "float32", "shape": [len(elements)], "names": list(elements)}
        for key, elements in names.items()
    }
    features |= {
        video.key: {
            "dtype": "video",
            "shape": list(video.shape),
            "names": ["height", "width", "channels"],
            "info": dict(video.info),
        }
        for video in videos
    }
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    features |= {name: {"dtype": "int64", "shape": [1], "names": None} for name in INDICES}
    info = {
        "codebase_version": VERSION,
        "fps": fps,
        "features": features,
        "total_episodes": len(episodes),
        "total_frames": data.num_rows,
        "total_tasks": len(tasks),
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH if videos else None,
        "robot_type": ROBOT_TYPE,
        "splits": {"train": f"0:{len(episodes)}"},
    }
    stats: dict[str, Any] = table_stats(data) | {video.key: video.whole_stats for video in videos}
    for part in ("meta/episodes/chunk-000", "data/chunk-000"):
        make_folder(folder / part, ConfigError)
    with refused_as(folder, ConfigError):
        with pq.ParquetWriter(folder / f"data/{FIRST}.parquet", data.schema) as writer:
            for table in tables:
                writer.write_table(table)  # a row group for each episode
        pq.write_table(_task_table(tasks), folder / "meta/tasks.parquet")
        pq.write_table(
            _episode_table(episodes, tables, videos, fps), folder / f"meta/episodes/{FIRST}.parquet"
        )
    for name, content in (("info", info), ("stats", stats)):
        text = msgspec.json.format(msgspec.json.encode(content), indent=4)
        write_atomically(folder / f"meta/{name}.json", text, ConfigError)


def _tables(episodes: Sequence[Episode], tasks: Sequence[str], fps: int) -> list[pa.Table]:
    tables = []
    begin = 0
    for number, episode in enumerate(episodes):
        count = len(episode.times_us)
        frames = np.arange(count)
        columns: dict[str, Any] = {
            key: pa.FixedSizeListArray.from_arrays(
                pa.array(values.astype(np.float32).ravel()), values.shape[1]
            )
            for key, values in episode.columns.items()
        }
        columns["timestamp"] = pa.array((frames / fps).astype(np.float32))
        task = tasks.index(episode.task)
        for name, values in zip(
            INDICES, (frames, frames * 0 + number, begin + frames, frames * 0 + task), strict=True
        ):
            columns[name] = pa.array(values.astype(np.int64))
        tables.append(pa.table(columns))
        begin += count
    return tables


def table_stats(table: pa.Table) -> dict[str, Stats]:
    """Return LeRobot's statistics of each column: a list with an entry for each element."""
    found = {}
    for name in table.column_names:
        column = table.column(name).combine_chunks()
        if pa.types.is_fixed_size_list(column.type):
            values = column.values.to_numpy(zero_copy_only=False).reshape(-1, column.type.list_size)
        else:
            values = column.to_numpy(zero_copy_only=False).reshape(-1, 1)
        found[name] = array_stats(values.astype(np.float64), len(values))
    return found


def array_stats(values: Array, count: int) -> Stats:
    """Return the statistics of values (n, elements); count: number of frames."""
    stats = {
        "min": values.min(axis=0).tolist(),
        "max": values.max(axis=0).tolist(),
        "mean": values.mean(axis=0).tolist(),
        "std": values.std(axis=0).tolist(),
        "count": [count],
    }
    return stats | {name: np.quantile(values, at, axis=0).tolist() for name, at in QUANTILES.items()}


def _task_table(tasks: Sequence[str]) -> pa.Table:
    """Return the tasks as pandas writes a frame whose index is the task: LeRobot looks tasks up by index."""
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks)})
    text = {"pandas_type": "unicode", "numpy_type": "object"}
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [{"name": None, "field_name": None, **text, "metadata": {"encoding": "UTF-8"}}],
        "columns": [
            {
                "name": "task_index",
                "field_name": "task_index",
                "pandas_type": "int64",
                "numpy_type": "int64",
                "metadata": None,
            },
            {"name": "task", "field_name": "task", **text, "metadata": None},
        ],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.2.0",
    }
    return table.replace_schema_metadata({"pandas": msgspec.json.encode(pandas)})


def _episode_table(
    episodes: Sequence[Episode], tables: Sequence[pa.Table], videos: Sequence[VideoFeature], fps: int
) -> pa.Table:
    rows = []
    begin = 0
    for number, (episode, table) in enumerate(zip(episodes, tables, strict=True)):
        count = table.num_rows
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [episode.task],
            "length": count,
            "data/chunk_index": 0,
            "data/file_index": 0,
            "dataset_from_index": begin,
            "dataset_to_index": begin + count,
        }
        stats: dict[str, Any] = table_stats(table)
        for video in videos:
            row |= {
                f"videos/{video.key}/chunk_index": 0,
                f"videos/{video.key}/file_index": 0,
                f"videos/{video.key}/from_timestamp": begin / fps,
                f"videos/{video.key}/to_timestamp": (begin + count) / fps,
            }
            stats[video.key] = video.episode_stats[number]
        row |= {f"stats/{key}/{name}": value for key, of in stats.items() for name, value in of.items()}
        rows.append(row | {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0})
        begin += count
    return pa.Table.from_pylist(rows)
