"""The importer makes a pose dataset of folders laid out as those of tactile_data_shear."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from bench.tactip_dataset import make_dataset

from palpate_edge.datasets.pose_dataset import read_pose_dataset

HEADER = (
    "sensor_image,object_label,pose_x,pose_y,pose_z,pose_Rx,pose_Ry,pose_Rz,shear_x,shear_y,shear_z,shear_Rx,"
    "shear_Ry,shear_Rz\n"
)


def folder_of(path, numbers, pictures):
    (path / "processed_images").mkdir(parents=True)
    for number in pictures:
        cv2.imwrite(str(path / "processed_images" / f"image_{number}.png"), np.zeros((30, 20), np.uint8))
    rows = [f"image_{n}.png,surface,0,0,{n},11,-12,0,1.5,-2.5,0,0,0,3.25\n" for n in numbers]
    (path / "targets_images.csv").write_text(HEADER + "".join(rows))
    return path


@pytest.mark.parametrize(("pictures", "references"), [((0, 1, 2, 3), ["image_0.png"]), ((1, 2, 3), None)])
def test_labels_splits_and_reference_frames(tmp_path, pictures, references):
    train = folder_of(tmp_path / "train", (1, 2, 3), pictures)
    val = folder_of(tmp_path / "val", (7,), (7,))
    make_dataset(train, val, tmp_path / "out", presses=2)
    dataset = read_pose_dataset(tmp_path / "out")
    assert dataset.sensor.image_size_px == (20, 30)
    assert [path.name for path in dataset.reference] == (
        references or ["image_1.png", "image_2.png", "image_3.png"]
    )
    assert [press.frame for press in dataset.split("train")] == ["train_image_1.png", "train_image_3.png"]
    (press,) = dataset.split("test")
    assert press.values == (7.0, 11.0, -12.0, 1.5, -2.5, 3.25)
    assert dataset.read(dataset.path(press)).shape[:2] == (30, 20)
