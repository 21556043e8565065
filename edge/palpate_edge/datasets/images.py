"""Read image files: complete, 8-bit, grey or BGR; anything else is refused."""

from __future__ import annotations

import zlib
from pathlib import Path

import cv2
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import DatasetError, reason_of

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp"})
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
VIDEO_SUFFIXES = frozenset({".mp4", ".m4v", ".avi", ".mkv", ".webm", ".mov"})


def list_images(folder: Path) -> list[Path]:
    """Return the image files of a folder in name order. Raises DatasetError when there is none."""
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder: give a folder of images, a press dataset or a video")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
    if not paths:
        raise DatasetError(f"{folder} has no image: put .png or .jpg frames there")
    return paths


def read_image(path: Path, *, grey: bool = False) -> Image:
    """Read one image, (height, width[, 3]) uint8. Raises DatasetError when missing, cut short or no image."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: {reason_of(error)}") from None
    if not data:
        raise DatasetError(f"{path} is empty: record or copy it again")
    if not _is_whole(data):
        raise DatasetError(f"{path} is cut short or damaged ({len(data)} bytes): record or copy it again")
    flags = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:  # a header that promises more pixels than OpenCV allows
        image = None
    if image is None:
        raise DatasetError(f"{path} is not an image that can be decoded: record or copy it again")
    return np.asarray(image, dtype=np.uint8)


def read_sized_image(
    path: Path,
    size_px: tuple[int, int],
    *,
    grey: bool = False,
    error: type[Exception] = DatasetError,
) -> Image:
    """Read one image of a dataset whose sensor.toml has size_px (width, height); `error` for another size."""
    image = read_image(path, grey=grey)
    width, height = size_px
    if image.shape[:2] != (height, width):
        raise error(
            f"{path} is {image.shape[1]}x{image.shape[0]}, sensor.toml has {width}x{height}: "
            "correct one of them"
        )
    return image


def _is_whole(data: bytes) -> bool:
    """Return whether a JPEG has its end marker and a PNG its checksums; other formats pass.

    OpenCV decodes a cut JPEG to a half-grey picture, and libpng prints to stderr for a damaged PNG, so both
    are checked before decoding. A JPEG has no checksum.
    """
    if data.startswith(b"\xff\xd8"):
        return b"\xff\xd9" in data[-64:]
    if data.startswith(PNG_SIGNATURE[:4]):
        return _png_chunks_are_whole(data)
    return True


def _png_chunks_are_whole(data: bytes) -> bool:
    """Return whether every chunk up to IEND has the CRC that it carries (PNG specification, 5.3)."""
    at = len(PNG_SIGNATURE)
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if zlib.crc32(data[at + 4 : end]).to_bytes(4, "big") != data[end : end + 4]:
            return False
        if data[at + 4 : at + 8] == b"IEND":
            return True
        at = end + 4
    return False
