"""Datasets of `palpate-host lerobot`, in LeRobot's own loader and viewer (make lerobot-test)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from tests.integrations.conftest import HAND, PROJECT
from tests.integrations.lerobot_readers import load, view

from palpate_host.cli.main import cli
from palpate_host.common.status import HostStatus
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

pytestmark = pytest.mark.lerobot

LOG = PROJECT / "tests/replay/virtual.log.gz"
EPISODES, PICTURES, PICTURE_US = 2, 20, 100_000
FINGERS = ("finger-1", "finger-2", "finger-3")
VIDEO_ERROR = 12.0
"""Mean error of a decoded channel, of 255, after MPEG-4 and JPEG."""


@dataclass(frozen=True)
class Exported:
    folder: Path
    statuses: list[HostStatus]
    found: dict[str, Any]
    """Content of the dataset by LeRobot's loader."""


def picture(number: int, finger: int) -> np.ndarray:
    """Draw two halves whose brightness is the picture's number; the finger's own channel is the darkest."""
    image = np.full((48, 64, 3), 6 * number + 120, np.uint8)
    image[:24] = 255 - 6 * number
    image[..., finger] = 20
    return image


@pytest.fixture(scope="module")
def exported(lerobot, tmp_path_factory) -> Exported:
    """One recorded run twice, with pictures of every finger."""
    folder = tmp_path_factory.mktemp("exported")
    statuses = list(read_statuses(LOG, *load_hand(HAND)))
    arguments = ["lerobot", *[LOG] * EPISODES, "--config", HAND, "-o", folder / "set"]
    arguments += ["--task", "Turn it.", "--fps", 50]
    for finger, name in enumerate(FINGERS):
        frames = ["frame,exposed_at_us,sequence"]
        (folder / name).mkdir()
        for number in range(PICTURES):
            cv2.imwrite(str(folder / name / f"{number}.png"), picture(number, finger))
            frames.append(f"{number}.png,{statuses[0].time_us + PICTURE_US * number},{number}")
        (folder / name / "frames.csv").write_text("\n".join(frames) + "\n")
        arguments += ["--camera", f"{name}={folder / name}"]
    done = CliRunner().invoke(cli, list(map(str, arguments)))
    assert done.exit_code == 0, done.output
    return Exported(folder / "set", statuses, load(lerobot, folder / "set"))


def test_the_loader_reads_what_the_export_wrote(exported: Exported) -> None:
    """Values as in the statuses, pictures decoded."""
    found = exported.found
    assert found["episodes"] == EPISODES and found["robot_type"] == "palpate_hand"
    positions = np.array(
        [[joint.position_rad for joint in status.joints] for status in exported.statuses], dtype=float
    )
    known = positions[~np.isnan(positions).any(axis=1)]
    joints = np.array(found["state"])[:1]
    assert np.abs(known - joints).max(axis=1).min() < 1e-6  # the first frame is one of the ticks
    for name in FINGERS:
        shape, deviation = found["pictures"][f"observation.images.{name}"]
        assert shape == [3, 48, 64] and deviation > 0.1


def test_the_viewer_shows_every_value_and_camera(lerobot, exported: Exported, tmp_path: Path) -> None:
    """Every episode has state and action of every frame under the joints' names, and all pictures."""
    found, joints = exported.found, [joint.name for joint in exported.statuses[0].joints]
    assert found["plotted_names"] == {
        "observation.state": [f"{joint}.pos_rad" for joint in joints],
        "action": [f"{joint}.torque_Nm" for joint in joints],
    }
    for episode in range(EPISODES):
        viewed = view(lerobot, exported.folder, episode, tmp_path)
        rows = np.array(found["episode_index"]) == episode
        assert np.array_equal(viewed.plots["state"], np.array(found["state"])[rows])
        assert np.array_equal(viewed.plots["action"], np.array(found["action"])[rows])
        assert set(viewed.pictures) == {f"observation.images.{name}" for name in FINGERS}
        for finger, name in enumerate(FINGERS):
            shown = viewed.pictures[f"observation.images.{name}"]
            assert len(shown) == rows.sum()
            error = np.abs(shown[-1].astype(float) - picture(PICTURES - 1, finger)).mean(axis=(0, 1))
            assert error.max() < VIDEO_ERROR
