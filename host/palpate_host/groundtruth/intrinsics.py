"""A camera's focal lengths, centre and distortion from pictures of a ChArUco board, and their file.

Pure except for reading and writing the file. Distortion is Brown's in OpenCV's order k1, k2, p1, p2, k3; k3
is left at 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.config_file import read_json
from palpate_edge.common.errors import ConfigError
from palpate_host.groundtruth.marker import DICTIONARY

Positive = Annotated[float, msgspec.Meta(gt=0)]

MIN_PICTURES = 8
MIN_CORNERS = 8
MIN_MOVE_PX = 8.0
"""Least mean motion of the corners since the last used picture: a board at rest adds no information."""
MIN_TILT_RANGE_DEG = 15.0
MAX_PICTURES = 60
MAX_RMS_PX = 1.0


class Intrinsics(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The file of ``groundtruth calibrate``. rms_px: of the corners; pictures: number of pictures used."""

    width_px: int
    height_px: int
    fx_px: Positive
    fy_px: Positive
    cx_px: float
    cy_px: float
    distortion: tuple[float, float, float, float, float]
    rms_px: float
    pictures: int

    @property
    def matrix_px(self) -> Array:
        """The pinhole matrix (3, 3)."""
        return np.array([[self.fx_px, 0.0, self.cx_px], [0.0, self.fy_px, self.cy_px], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class Board:
    """A ChArUco board: a chessboard of `across` x `down` squares with a marker in each white one."""

    across: int = 7
    down: int = 5
    square_m: float = 0.030
    marker_m: float = 0.022

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """Return OpenCV's board. Raises ConfigError when the numbers or sizes are impossible."""
        if self.across < 3 or self.down < 3 or not 0.0 < self.marker_m < self.square_m:
            raise ConfigError(
                "a board has at least 3 x 3 squares, each larger than its marker: correct --board"
            )
        if self.across * self.down // 2 > 50:
            raise ConfigError("a board has at most 50 markers: give fewer squares with --board")
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        return cv2.aruco.CharucoBoard((self.across, self.down), self.square_m, self.marker_m, dictionary)

    def picture(self, px_a_square: int = 120) -> Image:
        """Return the board for printing, with a white margin of half a square."""
        size = (self.across * px_a_square, self.down * px_a_square)
        drawn = self.charuco().generateImage(size)
        margin = px_a_square // 2
        sides = (margin, margin, margin, margin)
        framed = cv2.copyMakeBorder(drawn, *sides, cv2.BORDER_CONSTANT, value=(255.0,))
        return np.asarray(framed, dtype=np.uint8)


@dataclass(frozen=True, slots=True)
class CalibratedCamera:
    """The result of `calibrate`.

    refused: reason -> number of pictures. corners_px: the corners (n, 2) that were used, which show the
    covered part of the picture.
    """

    intrinsics: Intrinsics
    refused: dict[str, int]
    corners_px: Array


def calibrate(
    pictures: Iterable[Image], board: Board, done: Callable[[], None] = lambda: None
) -> CalibratedCamera:
    """Calibrate a camera from its grey pictures (h, w); `done` is called for each picture.

    Raises ConfigError, with the reasons for refused pictures, when too few can be used, when the board was
    never tilted enough, or when no camera model fits.
    """
    detector = cv2.aruco.CharucoDetector(board.charuco())
    board_m = np.array(detector.getBoard().getChessboardCorners())
    refused: dict[str, int] = {}
    taken: list[tuple[Array, Array]] = []
    size: tuple[int, int] | None = None
    last: dict[int, Array] = {}
    for picture in pictures:
        done()
        size = size or (picture.shape[1], picture.shape[0])
        found = _corners(detector, picture, size)
        reason = found if isinstance(found, str) else _too_similar(found, last)
        if reason or isinstance(found, str):
            refused[reason] = refused.get(reason, 0) + 1
            continue
        last = found
        taken.append((board_m[list(found)], np.array(list(found.values()))))
    if len(taken) > MAX_PICTURES:
        taken = [taken[i] for i in np.linspace(0, len(taken) - 1, MAX_PICTURES).astype(int)]
    reasons = "".join(f"; {count} refused: {reason}" for reason, count in refused.items())
    if size is None or len(taken) < MIN_PICTURES:
        raise ConfigError(
            f"{len(taken)} pictures of the board can be used, {MIN_PICTURES} are needed{reasons}:"
            " move and tilt the board before the camera, near and far"
        )
    rms_px, K, distortion, turns, _ = cv2.calibrateCamera(
        [known_m.astype(np.float32) for known_m, _ in taken],
        [seen_px.astype(np.float32) for _, seen_px in taken],
        size,
        np.eye(3),
        np.zeros(5),
        flags=cv2.CALIB_FIX_K3,  # the third radial term diverges where the board never was
    )
    _check(rms_px, turns, reasons)
    k = np.ravel(distortion)
    intrinsics = Intrinsics(
        width_px=size[0],
        height_px=size[1],
        fx_px=float(K[0, 0]),
        fy_px=float(K[1, 1]),
        cx_px=float(K[0, 2]),
        cy_px=float(K[1, 2]),
        distortion=(float(k[0]), float(k[1]), float(k[2]), float(k[3]), float(k[4])),
        rms_px=float(rms_px),
        pictures=len(taken),
    )
    return CalibratedCamera(intrinsics, refused, np.vstack([seen_px for _, seen_px in taken]))


def _corners(
    detector: cv2.aruco.CharucoDetector, picture: Image, size: tuple[int, int]
) -> dict[int, Array] | str:
    """Return corner number -> position (2,) in px, or the reason for refusing the picture."""
    if (picture.shape[1], picture.shape[0]) != size:
        return "its size differs from the first picture"
    corners, ids, _, _ = detector.detectBoard(picture)
    numbers = [int(number) for number in np.ravel(ids)] if corners is not None and len(corners) else []
    if not numbers:
        return "no board found"
    if len(numbers) < MIN_CORNERS:
        return f"fewer than {MIN_CORNERS} corners of the board"
    return dict(zip(numbers, np.asarray(corners, dtype=np.float64).reshape(-1, 2), strict=True))


def _too_similar(found: dict[int, Array], last: dict[int, Array]) -> str:
    common = found.keys() & last.keys()
    if common and np.mean([np.linalg.norm(found[n] - last[n]) for n in common]) < MIN_MOVE_PX:
        return "the board has not moved"
    return ""


def _check(rms_px: float, turns: Iterable[object], reasons: str) -> None:
    if rms_px > MAX_RMS_PX:
        raise ConfigError(
            f"no camera fits the corners better than {rms_px:.2f} px{reasons}:"
            " give the board's true sizes with --board, keep it flat, avoid blur"
        )
    normals = np.array([cv2.Rodrigues(np.asarray(turn))[0][:, 2] for turn in turns])
    tilt_range_deg = float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1.0, 1.0))).max())
    if tilt_range_deg < MIN_TILT_RANGE_DEG:
        raise ConfigError(
            f"the board's tilts differ by {tilt_range_deg:.0f} deg only, too little for the focal length:"
            " tilt it by 30 deg and more, to each side"
        )


def read_intrinsics(path: Path) -> Intrinsics:
    """Read a file of `write_intrinsics`. Raises ConfigError when it cannot be read or is invalid."""
    return read_json(path, Intrinsics, guide="make it with palpate-host groundtruth calibrate")


def write_intrinsics(path: Path, intrinsics: Intrinsics) -> None:
    """Write the intrinsics as JSON. Raises ConfigError when the file cannot be written."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(intrinsics)) + b"\n", ConfigError)
