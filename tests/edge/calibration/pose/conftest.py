"""A drawn pose dataset and its calibration, made once."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.edge.calibration.pose.drawn_pad import DrawnPad

from palpate_edge.calibration.pose.calibrate_pose import calibrate_pose
from palpate_edge.calibration.pose.pose_calibration_file import save_pose_calibration
from palpate_edge.datasets.pose_dataset import read_pose_dataset
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration

PAD = DrawnPad()


@pytest.fixture(scope="session")
def pad() -> DrawnPad:
    return PAD


@pytest.fixture(scope="session")
def pad_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """120 train and 40 test presses. Read only."""
    return PAD.write(tmp_path_factory.mktemp("pad") / "pad", 120, 40)


@pytest.fixture(scope="session")
def pad_calibration(pad_dataset: Path) -> PoseCalibration:
    return calibrate_pose(read_pose_dataset(pad_dataset))


@pytest.fixture(scope="session")
def pad_calibration_file(pad_calibration: PoseCalibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pad") / "pad.cal"
    save_pose_calibration(pad_calibration, path)
    return path
