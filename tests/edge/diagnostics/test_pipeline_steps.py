"""Beads of one image without a layout, and the pictures of every step from a frame to its contact."""

from __future__ import annotations

import math

import cv2
import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.calibration.calibration_file import save_calibration
from palpate_edge.cli.main import cli
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.images import read_image
from palpate_edge.diagnostics.canvas import GREEN, RED, Panel, sheet
from palpate_edge.diagnostics.figures import draw_residuals
from palpate_edge.diagnostics.pipeline_figures import draw_steps
from palpate_edge.diagnostics.pipeline_steps import take_steps
from palpate_edge.geometry.sensor import View, bead_layout_mm
from palpate_edge.vision.unknown_layout import beads_without_layout


def count_of(picture, colour, tolerance=25):
    """Pixels of about one colour."""
    return int((np.abs(picture.astype(int) - np.array(colour)).max(axis=-1) < tolerance).sum())


def test_beads_in_light_and_shade_are_found_and_the_text_behind_them_is_not(another_dome):
    places = 30 + 32.0 * np.stack(np.meshgrid(np.arange(9), np.arange(6)), axis=-1).reshape(-1, 2)
    dome = another_dome(width=320, height=220, noise=1.0, skin_bgr=(220, 220, 220), bead_bgr=(20, 20, 20))
    drawn = dome.draw(places, np.full(len(places), 10.0), 3).astype(float)
    shade = np.where(np.arange(320) < 150, 1.0, 0.3)[
        None, :, None
    ]  # two thirds of the light gone on the right
    image = (drawn * shade).astype(np.uint8)
    for line, text in enumerate(("FingerVision", "touch sensing")):
        cv2.putText(image, text, (20, 50 + 64 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1)
    blobs, appearance, _ = beads_without_layout(image)
    distance = np.linalg.norm(blobs.position_px[:, None] - places[None], axis=2)
    assert not appearance.bright
    assert (distance.min(axis=1) < 3).all()  # none is a letter; the edge of the shade pulls at beads on it
    assert (distance.min(axis=0) < 3).sum() >= 52  # of 54


@pytest.fixture(scope="module")
def press(drawn_dome):
    """A drawn press with five beads hidden, and where it touches."""
    theta, phi, hidden = 0.7, 0.9, (3, 20, 50, 60, 80)
    true_mm = 30 * np.array(
        [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]
    )
    return drawn_dome.picture(drawn_dome.pressed_mm(theta, phi, 1.8), 1, hidden), true_mm, hidden


def test_the_steps_lead_to_the_contact(press, drawn_calibration):
    image, true_mm, hidden = press
    steps = take_steps(image, drawn_calibration, "drawn")
    assert np.flatnonzero(~steps.beads.found).tolist() == list(hidden)
    assert steps.raw.weight.sum() == pytest.approx(1)  # Eq. (2) is a mean of the neighbours' places
    assert steps.raw.weight @ steps.mesh.reference_px[steps.raw.around] == pytest.approx(steps.raw.point_px)
    assert steps.change[steps.raw.centre] == steps.change.max()
    assert steps.paper.in_contact
    assert math.dist(steps.paper.position_mm, true_mm) < 4
    assert steps.corrected is None  # no model in this calibration


def test_lost_beads_are_marked_red(press, drawn_calibration, drawn_dome):
    hidden = draw_steps(take_steps(press[0], drawn_calibration, "drawn"))
    whole = drawn_dome.picture(drawn_dome.pressed_mm(0.7, 0.9, 1.8), 1)
    all_found = draw_steps(take_steps(whole, drawn_calibration, "drawn"))
    first = np.s_[: hidden.shape[0] // 3, : hidden.shape[1] // 3]
    assert count_of(all_found[first], RED) == 0
    assert count_of(hidden[first], RED) > 100
    assert hidden.shape == all_found.shape
    assert hidden.shape[1] > 3 * 800


def test_an_untouched_frame_has_its_steps_too(drawn_dome, drawn_calibration):
    steps = take_steps(drawn_dome.picture(drawn_dome.beads_mm(), 5), drawn_calibration, "drawn")
    assert not steps.paper.in_contact
    assert draw_steps(steps).shape[2] == 3


@pytest.mark.parametrize(
    ("shape", "reason"), [((240, 330), "frame is 330x240"), ((240, 320), "frame is blank")]
)
def test_a_frame_of_another_camera_is_refused(drawn_calibration, shape, reason):
    with pytest.raises(DatasetError, match=f"other.png: {reason}.*give a frame of the sensor"):
        take_steps(np.full(shape, 128, dtype=np.uint8), drawn_calibration, "other.png")


@pytest.mark.long
def test_the_sample_with_its_correction_model(shared_data, tmp_path):
    sample = shared_data("press-sample")
    small = tmp_path / "sample"
    (small / "frames").mkdir(parents=True)
    for name in ("sensor.toml", "reference"):
        (small / name).symlink_to(sample / name)
    calibration, picture = tmp_path / "s.cal", tmp_path / "steps.png"
    run = CliRunner().invoke
    result = run(cli, ["calibrate", str(small), "-o", str(calibration), "--picture", str(tmp_path / "r.png")])
    assert result.exit_code == 0, result.output
    assert cv2.imread(str(tmp_path / "r.png")).shape[1] == 1280
    frame = str(sample / "frames" / "test_00022.jpg")
    result = run(cli, ["inspect", frame, "-o", str(picture), "--calibration", str(calibration)])
    assert result.exit_code == 0, result.output
    paper, corrected = result.output.splitlines()
    assert "paper's method: contact at" in paper
    x, y, z = (float(number) for number in corrected.split("contact at ")[1].split(" mm")[0].split(", "))
    assert math.dist((x, y, z), (16.2174, -11.8997, 22.2574)) < 1.5  # truth.csv
    assert "force unknown" in corrected  # no press told the stiffness
    page = cv2.imread(str(picture))
    assert count_of(page[2 * page.shape[0] // 3 :, 2 * page.shape[1] // 3 :], GREEN) > 30  # the 95 % circle


def test_a_residual_is_an_arrow_twenty_times_as_long(drawn_calibration, drawn_dataset):
    image = read_image(drawn_dataset / "reference" / "0.png")
    view = View(drawn_calibration.sensor.camera, drawn_calibration.pose)
    fitted = view.project(bead_layout_mm(drawn_calibration.sensor.markers)[0])
    still = tuple(
        msgspec.structs.replace(bead, x_px=float(x), y_px=float(y))
        for bead, (x, y) in zip(drawn_calibration.beads, fitted, strict=True)
    )
    moved = (msgspec.structs.replace(still[0], x_px=still[0].x_px + 3.0), *still[1:])
    pictures = [
        draw_residuals(image, msgspec.structs.replace(drawn_calibration, beads=beads))
        for beads in (still, moved)
    ]
    drawn = np.flatnonzero((pictures[0] != pictures[1])[54:].any(axis=2).any(axis=0))
    # 3 px, 20 times as long, in a picture 4 times as large
    assert drawn.max() - drawn.min() == pytest.approx(240, abs=10)


def test_residuals_of_a_learned_layout_are_small(drawn_dataset, tmp_path):
    folder = tmp_path / "bare"
    folder.mkdir()
    (folder / "reference").symlink_to(drawn_dataset / "reference")
    lines = (drawn_dataset / "sensor.toml").read_text().splitlines()
    (folder / "sensor.toml").write_text("\n".join(line for line in lines if not line.startswith("rings")))
    output = ["-o", str(tmp_path / "c.cal"), "--picture", str(tmp_path / "r.png"), "--no-model"]
    result = CliRunner().invoke(cli, ["calibrate", str(folder), *output])
    assert result.exit_code == 0, result.output
    assert "85 beads" in result.output
    residual_px = float(result.output.split("layout residual ")[1].split(" px")[0])
    assert residual_px < 0.3  # drawn without scatter
    assert cv2.imread(str(tmp_path / "r.png")) is not None


def test_a_close_up_shows_the_part_about_its_middle_at_the_same_size():
    image = np.zeros((101, 151), dtype=np.uint8)
    image[60:, 90:] = 200
    whole, close = Panel(image, 2.0), Panel(image, 2.0, about_px=np.array([90.0, 60.0]), zoom=2.5)
    assert whole.canvas.shape == close.canvas.shape == (202, 302, 3)
    close.circle(np.array([90.0, 60.0]), 1.0, RED, -1)
    rows, columns = np.nonzero((close.canvas == np.array(RED)).all(axis=2))
    assert rows.mean() == pytest.approx(101, abs=6)
    assert columns.mean() == pytest.approx(151, abs=6)
    lit = (close.canvas[..., 0] > 100).mean()
    assert 0.2 < lit < 0.3  # the lit corner is a quarter of the close-up


def test_a_sheet_holds_all_of_its_panels():
    panels = [np.full((10, 20, 3), 100 + number, dtype=np.uint8) for number in range(4)]
    page = sheet(panels, columns=3)
    assert [int((page == 100 + number).sum()) for number in range(4)] == [600] * 4


def test_a_diameter_with_a_calibration_is_refused(drawn_dataset):
    frame = str(drawn_dataset / "frames" / "000.png")
    result = CliRunner().invoke(
        cli, ["inspect", frame, "-o", "x.png", "--calibration", "c", "--diameter", "9"]
    )
    assert result.exit_code == 2
    assert "exclude each other" in result.output


def test_steps_that_cannot_be_written(drawn_calibration, drawn_dataset, tmp_path):
    save_calibration(drawn_calibration, tmp_path / "c.cal")
    frame = str(drawn_dataset / "frames" / "000.png")
    command = [
        "inspect",
        frame,
        "--calibration",
        str(tmp_path / "c.cal"),
        "-o",
        str(tmp_path / "no" / "s.png"),
    ]
    with pytest.raises(DatasetError, match="cannot be written"):
        CliRunner().invoke(cli, command, catch_exceptions=False)
