"""Bad files given to ``palpate-edge calibrate``, ``estimate`` and ``inspect``."""

from __future__ import annotations

import shutil

import cv2
import msgspec
import numpy as np
import pytest

from palpate_edge.calibration.calibration_file import save_calibration


@pytest.fixture
def dataset(drawn_dome, tmp_path):
    """A press dataset of our own to spoil: 5 reference frames, 4 presses."""
    return drawn_dome.write(tmp_path / "dome", presses=4)


@pytest.fixture
def estimate(refused, tmp_path, drawn_calibration_file):
    """Refusal of ``palpate-edge estimate FRAMES``."""

    def run(frames, calibration=drawn_calibration_file):
        return refused("estimate", frames, "--calibration", calibration, "--csv", tmp_path / "out.csv")

    return run


@pytest.fixture
def calibrate(refused, tmp_path):
    """Refusal of ``palpate-edge calibrate DATASET``."""
    return lambda dataset: refused("calibrate", dataset, "-o", tmp_path / "out.cal")


def cut(path, share=0.6):
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    return path


def says(text, *parts):
    for part in parts:
        assert str(part) in text


# Frames


def test_frames_that_are_not_there(estimate, tmp_path):
    says(estimate(tmp_path / "none"), tmp_path / "none", "no such folder", "give a folder of images")


def test_an_empty_folder(estimate, tmp_path):
    (tmp_path / "empty").mkdir()
    says(estimate(tmp_path / "empty"), tmp_path / "empty", "has no image", "put .png or .jpg frames there")


@pytest.mark.parametrize("number", [0, 2, 3], ids=["first", "middle", "last"])
def test_a_truncated_image(estimate, dataset, number):
    path = cut(dataset / "frames" / f"{number:03}.png")
    says(estimate(dataset), path, "is cut short", "record or copy it again")


@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 0.99])
def test_a_truncated_jpg(estimate, drawn_dome, tmp_path, share):
    path = tmp_path / "frame.jpg"
    cv2.imwrite(str(path), drawn_dome.picture(drawn_dome.beads_mm(), 1))
    says(estimate(cut(path, share)), path, "record or copy it again")


def test_a_text_file_named_as_an_image(estimate, tmp_path):
    path = tmp_path / "frame.png"
    path.write_text("not an image\n")
    says(estimate(path), path, "is not an image that can be decoded")


@pytest.mark.parametrize("suffix", ["mp4", "avi", "mkv", "webm"])
@pytest.mark.parametrize(
    "content", [b"", b"no video\n", bytes(range(256)) * 16], ids=["empty", "text", "bytes"]
)
def test_a_video_that_is_no_video(estimate, tmp_path, suffix, content):
    path = tmp_path / f"frames.{suffix}"
    path.write_bytes(content)
    says(estimate(path), path, "is not a video that can be decoded", "record or copy it again")


@pytest.mark.parametrize("kind", ["folder", "video"])
def test_frames_of_another_size(estimate, another_dome, tmp_path, drawn_calibration_file, kind):
    larger = another_dome(width=400, height=300)
    image = larger.picture(larger.beads_mm(), 1)
    path = tmp_path / "frames"
    if kind == "folder":
        path.mkdir()
        for number in range(3):
            cv2.imwrite(str(path / f"{number}.png"), image)
    else:
        path = tmp_path / "frames.avi"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (400, 300))
        for _ in range(3):
            writer.write(image)
        writer.release()
    said = estimate(path)
    says(said, path, "frames are 400x300", drawn_calibration_file, "320x240", "calibrate for this one")


# Calibration


def test_a_calibration_that_is_not_there(estimate, dataset, tmp_path):
    says(
        estimate(dataset, tmp_path / "none.cal"), tmp_path / "none.cal", "make it with palpate-edge calibrate"
    )


def test_a_calibration_that_was_changed(estimate, dataset, tmp_path, drawn_calibration_file):
    changed = tmp_path / "changed.cal"
    text = drawn_calibration_file.read_text()
    assert '"wall_mm": 5.0' in text
    changed.write_text(text.replace('"wall_mm": 5.0', '"wall_mm": 4.0'))
    says(
        estimate(dataset, changed),
        changed,
        "was changed or damaged",
        "make it again with palpate-edge calibrate",
    )


def test_a_calibration_that_was_cut_short(estimate, dataset, tmp_path, drawn_calibration_file):
    half = tmp_path / "half.cal"
    half.write_bytes(drawn_calibration_file.read_bytes())
    says(estimate(dataset, cut(half)), half, "is not valid JSON: cut short or damaged", "make it again")


def test_a_calibration_of_another_sensor(estimate, dataset, drawn_calibration_file):
    text = (dataset / "sensor.toml").read_text()
    (dataset / "sensor.toml").write_text(text.replace("wall_mm = 5.0", "wall_mm = 4.0"))
    said = estimate(dataset)
    says(
        said, drawn_calibration_file, dataset / "sensor.toml", "was made for sensor", "palpate-edge calibrate"
    )


def test_a_calibration_of_another_sensor_of_the_same_make(
    estimate, another_dome, tmp_path, drawn_calibration_file
):
    twin = another_dome(offset_mm=(-0.5, 0.4, -0.2), tilt_rad=(-0.012, 0.01), focal_scale=0.99)
    said = estimate(twin.write(tmp_path / "twin", presses=2))
    says(said, drawn_calibration_file, "of another sensor", "px off", "run palpate-edge calibrate")


def test_a_method_that_the_calibration_cannot_do(refused, dataset, tmp_path, drawn_calibration_file):
    said = refused(
        *("estimate", dataset, "--calibration", drawn_calibration_file),
        *("--csv", tmp_path / "out.csv", "--method", "corrected"),
    )
    says(said, "no correction model", "palpate-edge calibrate")


# Press datasets


@pytest.mark.parametrize(
    ("spoil", "parts"),
    [
        (shutil.rmtree, ["dome: no such folder", "give a press dataset's folder"]),
        (lambda d: (d / "sensor.toml").unlink(), ["sensor.toml: no such file", "docs/press-dataset.md"]),
        (lambda d: cut(d / "sensor.toml", 0.5), ["sensor.toml", "not valid TOML"]),
        (lambda d: (d / "sensor.toml").write_bytes(b"\xff\x00"), ["sensor.toml: line 1 is not UTF-8 text"]),
        (lambda d: shutil.rmtree(d / "reference"), ["reference: no such folder"]),
        (lambda d: [p.unlink() for p in (d / "reference").iterdir()], ["reference has no image"]),
        (lambda d: cut(d / "reference" / "0.png"), ["0.png is cut short"]),
        (lambda d: cut(d / "reference" / "3.png"), ["3.png is cut short"]),
        (lambda d: cut(d / "truth.csv", 0.9), ["truth.csv, line 5", "the file may be cut short"]),
        (
            lambda d: (d / "truth.csv").write_text("a,b\n1,2\n"),
            ["truth.csv: the first line must be frame,split"],
        ),
        (lambda d: (d / "frames" / "001.png").unlink(), ["001.png: no such file"]),
    ],
)
def test_a_dataset_that_cannot_be_calibrated(calibrate, dataset, spoil, parts):
    spoil(dataset)
    says(calibrate(dataset), *parts)


@pytest.mark.parametrize("level", [0, 255])
def test_reference_frames_that_show_nothing(calibrate, dataset, level):
    blank = np.full((240, 320, 3), level, dtype=np.uint8)
    for path in (dataset / "reference").iterdir():
        cv2.imwrite(str(path), blank)
    says(calibrate(dataset), "only 0 of 85 beads", "check markers.rings")


def test_reference_frames_of_another_size(calibrate, dataset, another_dome):
    larger = another_dome(width=400, height=300)
    for path in (dataset / "reference").iterdir():
        cv2.imwrite(str(path), larger.picture(larger.beads_mm(), 1))
    says(calibrate(dataset), "is 400x300, sensor.toml has 320x240", "correct one of them")


def test_no_rings_in_the_description_nor_in_the_reference_frames(calibrate, dataset):
    lines = (dataset / "sensor.toml").read_text().splitlines()
    (dataset / "sensor.toml").write_text("\n".join(line for line in lines if not line.startswith("rings")))
    for path in (dataset / "reference").iterdir():
        cv2.imwrite(str(path), np.full((240, 320, 3), 90, dtype=np.uint8))
    says(calibrate(dataset), "only 0 beads", "give markers.rings")


@pytest.mark.parametrize(
    ("spoil", "parts"),
    [
        (shutil.rmtree, ["dome: no such folder"]),
        (lambda d: (d / "truth.csv").unlink(), ["truth.csv", "no row"]),
        (lambda d: cut(d / "frames" / "003.png"), ["003.png is cut short"]),
    ],
)
def test_a_dataset_that_cannot_be_evaluated(refused, dataset, drawn_calibration_file, spoil, parts):
    spoil(dataset)
    says(refused("evaluate", dataset, "--calibration", drawn_calibration_file), *parts)


# Places to write to


@pytest.mark.parametrize("output", ["nowhere/out", "dome"])
def test_places_that_cannot_be_written(refused, dataset, tmp_path, drawn_calibration_file, output):
    path = tmp_path / output
    calibration = ("--calibration", drawn_calibration_file)
    for command in (
        ("calibrate", "--no-model", dataset, "-o", path),
        ("estimate", dataset, *calibration, "--csv", path),
        ("inspect", dataset / "reference" / "0.png", "-o", path),
    ):
        says(refused(*command), path, "cannot be written")


def test_a_result_of_before_stays_when_the_new_one_is_refused(estimate, dataset, tmp_path):
    (tmp_path / "out.csv").write_text("what was there before\n")
    cut(dataset / "frames" / "003.png")
    says(estimate(dataset), "is cut short")


def test_a_later_file_format_is_told(estimate, dataset, tmp_path, drawn_calibration):
    later = tmp_path / "later.cal"
    save_calibration(msgspec.structs.replace(drawn_calibration, version=9), later)
    says(estimate(dataset, later), later, "version 9", "make it again with palpate-edge calibrate")
