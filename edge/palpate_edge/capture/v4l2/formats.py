"""Pixel formats of cameras, and their conversion to grey or BGR images."""

from __future__ import annotations

from enum import Enum

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Image

JPEG_START, JPEG_END = b"\xff\xd8", b"\xff\xd9"
JPEG_PADDING = 1024  # bytes that a driver may leave after the end marker


class PixelCode(Enum):
    """FourCC codes, ordered by the cost of the conversion to grey."""

    GREY = "GREY"
    NV12 = "NV12"
    YU12 = "YU12"
    YUYV = "YUYV"
    MJPG = "MJPG"

    @property
    def fourcc(self) -> int:
        """The code as the kernel's v4l2_fourcc() makes it."""
        return int.from_bytes(self.value.encode(), "little")


class PixelLayout(msgspec.Struct, frozen=True):
    """The negotiated layout of a frame. bytesperline: of the first plane; 0 for MJPG."""

    code: PixelCode
    width: int
    height: int
    bytesperline: int

    @property
    def expected_bytes(self) -> int:
        """Bytes of a complete frame; for MJPG the least possible number."""
        if self.code is PixelCode.MJPG:
            return len(JPEG_START) + len(JPEG_END)
        rows = self.height * 3 // 2 if self.code in {PixelCode.NV12, PixelCode.YU12} else self.height
        return rows * self.bytesperline


def decode(data: memoryview, layout: PixelLayout, *, grey: bool) -> Image | None:
    """Return a new image (height, width) or (height, width, 3) BGR, uint8; None for an incomplete frame.

    data: the used bytes of the buffer, which may be returned to the driver afterwards.
    """
    if len(data) < layout.expected_bytes:
        return None
    if layout.code is PixelCode.MJPG:
        return _decode_jpeg(data, grey)
    raw = np.frombuffer(data, dtype=np.uint8, count=layout.expected_bytes)
    if layout.code is PixelCode.YUYV:
        return _from_yuyv(raw, layout, grey)
    luma = _plane(raw, layout.height, layout.bytesperline, layout.width)
    if grey:
        return luma.copy()
    if layout.code is PixelCode.GREY:
        return _bgr(luma, cv2.COLOR_GRAY2BGR)
    return _from_planes(raw, luma, layout)


def _plane(raw: NDArray[np.uint8], rows: int, stride: int, width: int) -> Image:
    return raw[: rows * stride].reshape(rows, stride)[:, :width]


def _from_yuyv(raw: NDArray[np.uint8], layout: PixelLayout, grey: bool) -> Image:
    rows = _plane(raw, layout.height, layout.bytesperline, 2 * layout.width)
    if grey:
        return rows[:, ::2].copy()
    pairs = np.ascontiguousarray(rows).reshape(layout.height, layout.width, 2)
    return _bgr(pairs, cv2.COLOR_YUV2BGR_YUYV)


def _from_planes(raw: NDArray[np.uint8], luma: Image, layout: PixelLayout) -> Image:
    """Convert NV12 and YU12: chroma planes follow the luma plane; padding at the end of lines is removed."""
    chroma = raw[layout.height * layout.bytesperline :]
    if layout.code is PixelCode.NV12:
        uv = _plane(chroma, layout.height // 2, layout.bytesperline, layout.width)
        return _bgr(np.vstack([luma, uv]), cv2.COLOR_YUV2BGR_NV12)
    quarters = _plane(chroma, layout.height, layout.bytesperline // 2, layout.width // 2)
    planes = np.ascontiguousarray(quarters).reshape(layout.height // 2, layout.width)
    return _bgr(np.vstack([luma, planes]), cv2.COLOR_YUV2BGR_I420)


def _decode_jpeg(data: memoryview, grey: bool) -> Image | None:
    """Decode a JPEG; None without its end marker: a truncated transfer would decode to a half-grey
    picture."""
    if data[:2] != JPEG_START or bytes(data[-JPEG_PADDING:]).rfind(JPEG_END) < 0:
        return None
    flags = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_COLOR
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:  # the header has more pixels than OpenCV allows
        return None
    return None if image is None else np.asarray(image, dtype=np.uint8)


def _bgr(image: Image, conversion: int) -> Image:
    return np.asarray(cv2.cvtColor(image, conversion), dtype=np.uint8)
