"""Each pixel format against OpenCV's own conversion of the same picture, with padding at the lines' ends."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from linuxpy.video import raw

from palpate_edge.capture.v4l2.formats import PixelCode, PixelLayout, decode

WIDTH, HEIGHT, PADDING = 64, 48, 32


@pytest.fixture
def picture():
    """Smooth colours (48, 64, 3), so that halved chroma loses little."""
    row, column = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.stack([3 * column, 4 * row, 250 - 2 * column - row], axis=2).astype(np.uint8)


def padded(plane, padding):
    return np.pad(plane, ((0, 0), (0, padding)), constant_values=77).tobytes()


def encoded(code, picture):
    """The picture as a driver gives it, from OpenCV's encoder: (bytes, layout)."""
    i420 = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)
    luma, chroma = i420[:HEIGHT], i420[HEIGHT:]
    layout = PixelLayout(code, WIDTH, HEIGHT, WIDTH + PADDING)
    quarter = chroma.reshape(HEIGHT, WIDTH // 2)
    if code is PixelCode.GREY:
        return padded(luma, PADDING), layout
    if code is PixelCode.YU12:
        return padded(luma, PADDING) + padded(quarter, PADDING // 2), layout
    if code is PixelCode.NV12:
        uv = np.stack([quarter[: HEIGHT // 2], quarter[HEIGHT // 2 :]], axis=2).reshape(HEIGHT // 2, WIDTH)
        return padded(luma, PADDING) + padded(uv, PADDING), layout
    if code is PixelCode.YUYV:
        pairs = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_YUYV).reshape(HEIGHT, 2 * WIDTH)
        return padded(pairs, PADDING), PixelLayout(code, WIDTH, HEIGHT, 2 * WIDTH + PADDING)
    _, jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 95])
    return jpeg.tobytes() + bytes(16), PixelLayout(code, WIDTH, HEIGHT, 0)


@pytest.mark.parametrize("code", list(PixelCode), ids=lambda code: code.value)
def test_fourcc_is_the_kernels(code):
    theirs = {"YU12": "YUV420", "MJPG": "MJPEG"}.get(code.value, code.value)
    assert code.fourcc == getattr(raw.PixelFormat, theirs)


@pytest.mark.parametrize("code", [one for one in PixelCode if one is not PixelCode.MJPG])
def test_grey_is_the_luma_that_was_sent_bit_for_bit(code, picture):
    data, layout = encoded(code, picture)
    got = decode(memoryview(data), layout, grey=True)
    luma = (
        cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_YUYV)[:, :, 0]
        if code is PixelCode.YUYV
        else cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)[:HEIGHT]
    )
    assert np.array_equal(got, luma)
    assert got.base is None  # a copy: the driver gets its buffer back


@pytest.mark.parametrize("code", [PixelCode.NV12, PixelCode.YU12, PixelCode.YUYV, PixelCode.MJPG])
def test_colour_comes_back(code, picture):
    data, layout = encoded(code, picture)
    got = decode(memoryview(data), layout, grey=False)
    assert got.shape == picture.shape
    assert np.abs(got.astype(int) - picture).mean() < 4  # halved chroma and rounding


def test_colour_of_a_grey_camera_is_grey(picture):
    data, layout = encoded(PixelCode.GREY, picture)
    got = decode(memoryview(data), layout, grey=False)
    assert np.array_equal(got[..., 0], got[..., 2])


def test_grey_of_a_jpeg_is_opencvs(picture):
    data, layout = encoded(PixelCode.MJPG, picture)
    theirs = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert np.array_equal(decode(memoryview(data), layout, grey=True), theirs)


@pytest.mark.parametrize("code", list(PixelCode), ids=lambda code: code.value)
@pytest.mark.parametrize("part", [0.0, 0.5, 0.98])
def test_a_frame_that_was_cut_short_is_none(code, part, picture):
    data, layout = encoded(code, picture)
    whole = len(data) - (16 if code is PixelCode.MJPG else 0)
    assert decode(memoryview(data)[: int(part * whole)], layout, grey=True) is None


def test_a_jpeg_of_noise_is_none():
    layout = PixelLayout(PixelCode.MJPG, WIDTH, HEIGHT, 0)
    noise = b"\xff\xd8" + bytes(range(256)) + b"\xff\xd9"
    assert decode(memoryview(noise), layout, grey=True) is None
