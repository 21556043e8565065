"""Reading of pose datasets: what is there, and what is refused with file, line and column."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.pose_dataset import is_pose_dataset, read_pose_dataset

SENSOR = "[camera]\nwidth = 64\nheight = 48\n"
TRUTH = "frame,split,tilt_x_deg,depth_mm,note\na.png,train,1.5,0.25,x\nb.png,test,-2,1e-1,\n"


def make(folder, sensor=SENSOR, truth=TRUTH):
    (folder / "reference").mkdir()
    cv2.imwrite(str(folder / "reference" / "0.png"), np.zeros((48, 64), np.uint8))
    (folder / "sensor.toml").write_text(sensor)
    (folder / "truth.csv").write_text(truth)
    return folder


def test_columns_stand_in_any_order_beside_others(tmp_path):
    dataset = read_pose_dataset(make(tmp_path))
    assert dataset.labels == ("depth_mm", "tilt_x_deg")
    assert [(p.frame, p.split, p.values) for p in dataset.presses] == [
        ("a.png", "train", (0.25, 1.5)),
        ("b.png", "test", (0.1, -2.0)),
    ]
    assert dataset.sensor.image_size_px == (64, 48)
    assert dataset.mask is None
    assert is_pose_dataset(tmp_path)


@pytest.mark.parametrize("header", ["frame,split,t_s,x_mm,y_mm,z_mm,depth_mm\n", "frame,split\n", ""])
def test_a_table_with_places_or_without_labels_is_no_pose_dataset(tmp_path, header):
    assert not is_pose_dataset(make(tmp_path, truth=header))


@pytest.mark.parametrize(
    ("truth", "reason"),
    [
        ("frame,split\n", "first line must have frame, split and any of depth_mm"),
        ("frame,split,depth_mm,depth_mm\n", "each once"),
        ("frame,split,depth_mm\na.png,train\n", "line 2 has 2 fields, not 3"),
        ("frame,split,depth_mm\na.png,train,\n", 'line 2: depth_mm = "" is not a finite number'),
        ("frame,split,depth_mm\na.png,train,nan\n", 'line 2: depth_mm = "nan" is not a finite number'),
        ("frame,split,depth_mm\n../a.png,train,1\n", "is not a file name"),
        ("frame,split,depth_mm\na.png,val,1\n", 'split = "val" is not one of train, test'),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path, truth, reason):
    with pytest.raises(DatasetError) as refusal:
        read_pose_dataset(make(tmp_path, truth=truth))
    assert reason in str(refusal.value)


@pytest.mark.parametrize(
    ("sensor", "reason"),
    [
        ("[camera]\nwidth = 64\nheight = 3\n", "camera.height = 3 is out of range"),
        (SENSOR + "[markers]\ncount = 3\n", "7 to 2000, or left out"),
        (SENSOR + "[markers]\ndiameter_px = 1\n", "markers.diameter_px"),
        (SENSOR + '[markers]\nlayout = "hexagonal"\ncount = 330\n', "217, 271, 331"),
        (SENSOR + '[markers]\nlayout = "round"\n', "hexagonal, any"),
    ],
)
def test_a_wrong_description_is_refused_with_its_key(tmp_path, sensor, reason):
    with pytest.raises(DatasetError) as refusal:
        read_pose_dataset(make(tmp_path, sensor=sensor))
    assert reason in str(refusal.value)


def test_an_image_of_another_size_is_refused(tmp_path):
    cv2.imwrite(str(make(tmp_path) / "mask.png"), np.ones((20, 20), np.uint8))
    with pytest.raises(DatasetError, match=r"is 20x20, sensor\.toml has 64x48"):
        read_pose_dataset(tmp_path)
