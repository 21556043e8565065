"""Readers of a dataset: LeRobot's own loader and its viewer."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rerun.chunk import RrdReader

from palpate_edge.common.arrays import Array, Image

LOAD = """
import json, sys
import numpy as np
from lerobot.datasets import LeRobotDataset
from lerobot.scripts.lerobot_dataset_viz import get_feature_names

folder = sys.argv[1]
dataset = LeRobotDataset("local/palpate", root=folder)
features = dataset.features
rows = dataset.hf_dataset.with_format("numpy")
found = {
    "episodes": dataset.num_episodes,
    "frames": dataset.num_frames,
    "robot_type": dataset.meta.robot_type,
    "state_names": features["observation.state"]["names"],
    "action_names": features["action"]["names"],
    "plotted_names": {key: get_feature_names(dataset, key) for key in ("observation.state", "action")},
    "episode_index": np.asarray(rows["episode_index"]).tolist(),
    "state": np.asarray(rows["observation.state"]).tolist(),
    "action": np.asarray(rows["action"]).tolist(),
}
first = dataset[0]
cameras = [key for key in features if key.startswith("observation.images")]
found["pictures"] = {key: [list(first[key].shape), float(first[key].std())] for key in cameras}
print("FOUND " + json.dumps(found))
"""


def load(lerobot: Callable[..., str], folder: Path) -> dict[str, Any]:
    """Return what LeRobot's own loader finds in a dataset."""
    output = lerobot("python", "-c", LOAD, folder)
    (line,) = (line for line in output.splitlines() if line.startswith("FOUND "))
    found: dict[str, Any] = json.loads(line.removeprefix("FOUND "))
    return found


@dataclass(frozen=True)
class Viewed:
    """Content of an episode in the viewer: each plot (frames, elements), and each camera's pictures (BGR)."""

    plots: dict[str, Array]
    pictures: dict[str, list[Image]]


def view(lerobot: Callable[..., str], folder: Path, episode: int, output: Path) -> Viewed:
    """Let ``lerobot-dataset-viz`` save an episode for Rerun, and return what Rerun reads from it."""
    lerobot(
        "lerobot-dataset-viz",
        "--repo-id=local/palpate",
        f"--root={folder}",
        f"--episode-index={episode}",
        "--save=1",
        f"--output-dir={output}",
        "--num-workers=0",
        "--display-compressed-images",
    )
    rows: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    for chunk in RrdReader(output / f"local_palpate_episode_{episode}.rrd").stream().to_chunks():
        batch = chunk.to_record_batch()
        for component in ("Scalars:scalars", "EncodedImage:blob"):
            if component in batch.schema.names:
                frames, values = batch["frame_index"].to_pylist(), batch[component].to_pylist()
                rows[chunk.entity_path.lstrip("/")] += zip(frames, values, strict=True)
    shown = {entity: [value for _, value in sorted(found)] for entity, found in rows.items()}
    cameras = {entity for entity in shown if entity.startswith("observation.images")}
    return Viewed(
        {entity: np.array(values) for entity, values in shown.items() if entity not in cameras},
        {entity: [decoded(blob) for (blob,) in shown[entity]] for entity in cameras},
    )


def decoded(blob: list[int]) -> Image:
    """Return the picture in the bytes of a JPEG file."""
    image = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image
