"""The external camera: intrinsics and poses from rendered pictures whose truth is known."""

from __future__ import annotations

import csv
import functools
import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from palpate_edge.common.errors import ConfigError
from palpate_host.cli.main import cli
from palpate_host.groundtruth.intrinsics import Board, Intrinsics, calibrate, write_intrinsics
from palpate_host.groundtruth.marker import MarkerCamera, Refusal
from palpate_host.groundtruth.track import Marker, ObjectTracker
from palpate_twin.closed_loop.external_camera import ExternalCamera, camera_above

SIZE_PX = (640, 480)
TRUE_K = np.array([[560.0, 0.0, 313.0], [0.0, 556.0, 244.0], [0.0, 0.0, 1.0]])
TRUE_DISTORTION = np.array([-0.22, 0.06, 0.0008, -0.0006, 0.0])
BOARD = Board()
PX_A_SQUARE = 120  # of Board.picture


def undistorted(points: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Brown's model turned round by fixed-point iteration; normalised coordinates (n, 2)."""
    k1, k2, p1, p2, k3 = k
    found = points.copy()
    for _ in range(12):
        x, y = found.T
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        shift = np.column_stack(
            (2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y)
        )
        found = (points - shift) / radial[:, None]
    return found


@functools.cache
def rays(dx: float, dy: float) -> np.ndarray:
    """(n, 3) of every pixel, ahead 1, that far from its middle."""
    u, v = np.meshgrid(np.arange(SIZE_PX[0]) + dx, np.arange(SIZE_PX[1]) + dy)
    distorted = (np.column_stack((u.ravel(), v.ravel())) - TRUE_K[:2, 2]) / [TRUE_K[0, 0], TRUE_K[1, 1]]
    return np.column_stack((undistorted(distorted, TRUE_DISTORTION), np.ones(u.size)))


def board_seen(turn_deg: tuple[float, float, float], place_m: tuple[float, float, float]) -> np.ndarray:
    """The board as that camera sees it: two by two rays for a pixel's light."""
    R = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    origin = np.array(place_m) - R @ (np.array([BOARD.across, BOARD.down, 0]) * BOARD.square_m / 2)
    picture = BOARD.picture(PX_A_SQUARE)
    total = np.zeros(SIZE_PX[::-1])
    for dx, dy in itertools.product((-0.25, 0.25), repeat=2):
        along = (R[:, 2] @ origin) / (rays(dx, dy) @ R[:, 2])
        on_board_m = (rays(dx, dy) * along[:, None] - origin) @ R
        px = (on_board_m[:, :2] / BOARD.square_m + 0.5) * PX_A_SQUARE - 0.5
        across, down = (px[:, axis].reshape(total.shape).astype(np.float32) for axis in (0, 1))
        total += cv2.remap(picture, across, down, cv2.INTER_LINEAR, borderValue=(140.0,)) / 4
    noise = np.random.default_rng(0).normal(0, 2, total.shape)
    return np.clip(np.rint(total + noise), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def board_pictures() -> list[np.ndarray]:
    poses = [
        ((0, 0, 0), (0.0, 0.0, 0.32)),
        ((30, 0, 5), (0.02, 0.01, 0.32)),
        ((-30, 0, -5), (-0.03, 0.0, 0.34)),
        ((0, 30, 10), (0.03, -0.02, 0.33)),
        ((0, -30, 0), (-0.02, 0.02, 0.33)),
        ((25, 25, 45), (0.05, 0.03, 0.36)),
        ((-25, 20, 90), (-0.05, -0.04, 0.36)),
        ((20, -25, 20), (0.06, -0.04, 0.38)),
        ((-20, -20, -30), (-0.06, 0.04, 0.38)),
        ((10, 35, 0), (0.0, 0.04, 0.42)),
        ((35, -10, 180), (0.0, -0.04, 0.42)),
        ((15, 15, 0), (0.08, 0.05, 0.42)),
    ]
    return [board_seen(turn, place) for turn, place in poses]


@pytest.mark.long
def test_calibration_finds_the_camera_that_took_the_pictures(board_pictures: list[np.ndarray]) -> None:
    """Focal lengths within 0.3 %, the centre within 2 px, rays where the board was within 0.5 px."""
    calibrated = calibrate(board_pictures, BOARD)
    found = calibrated.intrinsics
    assert found.pictures == len(board_pictures)
    assert (found.fx_px, found.fy_px) == pytest.approx((560.0, 556.0), rel=0.003)
    assert (found.cx_px, found.cy_px) == pytest.approx((313.0, 244.0), abs=2.0)
    assert found.rms_px < 0.3
    pixels = calibrated.corners_px
    assert (np.ptp(pixels, axis=0) > 0.6 * np.array(SIZE_PX)).all()
    truth = undistorted((pixels - TRUE_K[:2, 2]) / [TRUE_K[0, 0], TRUE_K[1, 1]], TRUE_DISTORTION)
    K = found.matrix_px
    told = undistorted((pixels - K[:2, 2]) / [K[0, 0], K[1, 1]], np.array(found.distortion))
    apart = told - truth
    apart -= apart.mean(axis=0)  # a shift of all is the camera turned, which no pose relative to it shows
    assert 560.0 * np.linalg.norm(apart, axis=1).max() < 0.5


def test_pictures_that_teach_nothing_are_refused_with_a_reason(board_pictures: list[np.ndarray]) -> None:
    empty = np.full((480, 640), 128, dtype=np.uint8)
    found = calibrate([*board_pictures, empty, board_pictures[-1][:, :600]], BOARD)
    assert found.refused == {"no board found": 1, "its size differs from the first picture": 1}
    twice = [picture for picture in board_pictures for _ in range(2)]
    assert calibrate(twice, BOARD).refused == {"the board has not moved": len(board_pictures)}
    with pytest.raises(ConfigError, match="3 pictures of the board can be used, 8 are needed; 1 refused: no"):
        calibrate([*board_pictures[:3], empty], BOARD)
    with pytest.raises(ConfigError, match="too little for the focal length"):
        calibrate([np.roll(board_pictures[0], 12 * n, axis=1) for n in range(-5, 5)], BOARD)


def film(tmp_path: Path, turns: list[Rotation]) -> tuple[Path, Path, ExternalCamera]:
    """A video of the object's marker (7) and of the base's (3), lossless, and the camera's file."""
    camera = camera_above(np.array([0.0, 0.0, 0.1]), 0.06)
    base = ExternalCamera(camera.position_m, camera.target_m, 0.0, marker_id=3, side_m=0.02)
    rng = np.random.default_rng(1)
    writer = cv2.VideoWriter(
        str(tmp_path / "run.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 30.0, (1280, 720), isColor=False
    )
    assert writer.isOpened()
    for turn in turns:
        seen = camera.picture(turn.as_matrix(), np.array([0.0, 0.0, 0.1]), rng)
        # the base's marker lies flat beside the object and nothing hides it
        other = base.picture(np.eye(3), np.array([-0.07, 0.03, 0.05]), rng)
        marked = np.abs(other.astype(int) - 110) > np.abs(seen.astype(int) - 110)
        writer.write(np.where(marked, other, seen).astype(np.uint8))
    writer.release()
    file = tmp_path / "camera.json"
    K = camera.intrinsics_px.tolist()
    write_intrinsics(
        file,
        Intrinsics(
            width_px=1280,
            height_px=720,
            fx_px=K[0][0],
            fy_px=K[1][1],
            cx_px=K[0][2],
            cy_px=K[1][2],
            distortion=(0.0,) * 5,
            rms_px=0.1,
            pictures=9,
        ),
    )
    return tmp_path / "run.avi", file, camera


def test_a_video_tells_the_turn_about_the_hands_axes(tmp_path: Path) -> None:
    """Turns of up to 30 degrees about each axis: within 0.5 deg, 0.25 on average.

    Places within 3 mm at 110 mm from the base, whose 20 mm marker tells its own distance to 1 % only.
    """
    angles = [(0, 0, 0), (10, 0, 0), (25, 0, 0), (0, 12, 0), (0, 25, 0), (0, 0, 15), (0, 0, 30), (8, -6, 20)]
    turns = [Rotation.from_euler("xyz", angle, degrees=True) for angle in angles]
    video, intrinsics, _ = film(tmp_path, turns)
    poses, picture = tmp_path / "truth.csv", tmp_path / "last.png"
    arguments = ["track", str(video), "--intrinsics", str(intrinsics), "--marker", "7", "30"]
    arguments += ["--base", "3", "20", "-o", str(poses), "--picture", str(picture)]
    done = CliRunner().invoke(cli, ["groundtruth", *arguments])
    assert done.exit_code == 0, done.output
    assert f"{len(turns)} of {len(turns)} pictures have a pose" in done.output
    with poses.open(newline="") as file:
        rows = list(csv.DictReader(file))
    errors = []
    for index, (row, turn) in enumerate(zip(rows, turns, strict=True)):
        assert int(row["time_us"]) == round(index * 1e6 / 30)
        angles_deg = [float(row[f"{name}_deg"]) for name in ("roll", "pitch", "yaw")]
        told = Rotation.from_euler("xyz", angles_deg, degrees=True)
        errors.append(np.degrees((told * turn.inv()).magnitude()))
        top_m = turn.apply([0.0, 0.0, 0.03]) + np.array([0.0, 0.0, 0.1])
        expected_mm = 1e3 * (top_m - np.array([-0.07, 0.03, 0.05]))
        assert [float(row[f"{a}_mm"]) for a in "xyz"] == pytest.approx(expected_mm, abs=3.0)
    assert max(errors) < 0.5 and np.mean(errors) < 0.25
    drawn = cv2.imread(str(picture))
    assert drawn.shape == (720, 1280, 3)
    red = (drawn[..., 2] > 200) & (drawn[..., 0] < 60) & (drawn[..., 1] < 60)
    assert red.sum() > 100  # the x axis


def test_pictures_without_a_pose_say_why() -> None:
    camera = camera_above(np.array([0.0, 0.0, 0.1]), 0.06)
    rng = np.random.default_rng(0)
    seen = camera.picture(np.eye(3), np.array([0.0, 0.0, 0.1]), rng)
    empty = np.full_like(seen, 110)
    detector = MarkerCamera(camera.intrinsics_px, 7, 0.03)
    assert detector.measure(empty) == Refusal("marker 7 not found")
    assert MarkerCamera(camera.intrinsics_px, 8, 0.03).measure(seen) == Refusal(
        "marker 8 not found; the picture has [7]"
    )
    half = np.hstack((seen[:, 320:960], seen[:, 320:960]))
    assert detector.measure(half) == Refusal("marker 7 more than once; the picture has [7, 7]")
    far = ExternalCamera(10 * camera.position_m, camera.target_m, 0.03)
    small = far.picture(np.eye(3), np.array([0.0, 0.0, 0.1]), rng)
    refused = detector.measure(small)
    assert isinstance(refused, Refusal)
    tracker = ObjectTracker(
        Intrinsics(
            width_px=640,
            height_px=480,
            fx_px=1.0,
            fy_px=1.0,
            cx_px=0,
            cy_px=0,
            distortion=(0,) * 5,
            rms_px=0,
            pictures=9,
        ),
        Marker(7, 0.03),
    )
    assert tracker.look(0, seen).reason == "picture of 1280x720, the intrinsics are for 640x480"


def test_a_marker_seen_from_straight_above_and_far_is_ambiguous_not_wrong() -> None:
    """Nearly frontal, 35 px wide, its two poses fit alike, and noise would choose."""
    turn = Rotation.from_euler("x", 8, degrees=True).as_matrix()
    camera = ExternalCamera(np.array([0.0, 0.001, 1.3]), np.array([0.0, 0.0, 0.1]), 0.03)
    detector = MarkerCamera(camera.intrinsics_px, 7, 0.03)
    for seed in range(20):
        picture = camera.picture(turn, np.array([0.0, 0.0, 0.1]), np.random.default_rng(seed))
        measured = detector.measure(picture)
        assert isinstance(measured, Refusal) and "two poses" in measured.reason


def test_the_commands_say_what_is_wrong(tmp_path: Path, board_pictures: list[np.ndarray]) -> None:
    for number, picture in enumerate(board_pictures):
        cv2.imwrite(str(tmp_path / f"{number:02}.png"), picture)
    out = tmp_path / "out"
    out.mkdir()

    def run(*arguments: object) -> tuple[int, str]:
        done = CliRunner().invoke(cli, ["groundtruth", *map(str, arguments)])
        return done.exit_code, done.output + str(done.exception or "")

    status, said = run("calibrate", tmp_path, "-o", out / "camera.json", "--picture", out / "cover.png")
    assert status == 0 and "12 pictures" in said and (out / "cover.png").exists()
    status, said = run(
        "track", tmp_path, "--intrinsics", out / "camera.json", "--marker", 40, 30, "-o", out / "t.csv"
    )
    assert status != 0 and "no picture has a pose" in said
    assert len((out / "t.csv").read_text().splitlines()) == 13
    status, said = run(
        "track", tmp_path, "--intrinsics", out / "t.csv", "--marker", 7, 30, "-o", out / "t.csv"
    )
    assert status != 0 and "is not valid JSON" in said and "groundtruth calibrate" in said
    status, said = run(
        "track", tmp_path, "--intrinsics", out / "camera.json", "--marker", 77, 30, "-o", out / "t"
    )
    assert status != 0 and "has 0 to 49" in said
    status, said = run("board", "--board", 2, 2, 30, 22, "-o", out / "b.png")
    assert status != 0 and "at least 3 x 3" in said
    assert run("board", "-o", out / "b.png")[0] == 0 and cv2.imread(str(out / "b.png")) is not None
