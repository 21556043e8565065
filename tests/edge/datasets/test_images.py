"""Image files: whole or refused."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.images import list_images, read_image

FILES = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture(scope="module")
def encoded(drawn_dome):
    """The same picture as .png and as .jpg bytes."""
    image = drawn_dome.picture(drawn_dome.beads_mm(), seed=1)
    return {suffix: cv2.imencode(suffix, image)[1].tobytes() for suffix in (".png", ".jpg")} | {
        "image": image
    }


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png_of(width, height):
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    parts = ((b"IHDR", header), (b"IDAT", zlib.compress(b"\0")), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def refused(path):
    with pytest.raises(DatasetError) as error:
        read_image(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_a_png_is_read_exactly(encoded, tmp_path):
    (tmp_path / "a.png").write_bytes(encoded[".png"])
    assert np.array_equal(read_image(tmp_path / "a.png"), encoded["image"])
    grey = read_image(tmp_path / "a.png", grey=True)
    blue, green, red = np.moveaxis(encoded["image"].astype(float), -1, 0)
    assert np.abs(grey - (0.114 * blue + 0.587 * green + 0.299 * red)).max() <= 1  # ITU-R BT.601


@FILES
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@given(data=st.data())
def test_a_truncated_image_is_refused(encoded, tmp_path, suffix, data):
    end = data.draw(st.integers(0, len(encoded[suffix]) - 1))
    (tmp_path / f"cut{suffix}").write_bytes(encoded[suffix][:end])
    refused(tmp_path / f"cut{suffix}")


@FILES
@given(data=st.data())
def test_a_png_with_any_changed_byte_is_refused(encoded, tmp_path, data):
    whole = encoded[".png"]
    at = data.draw(st.integers(8, len(whole) - 1))
    (tmp_path / "bent.png").write_bytes(whole[:at] + bytes([whole[at] ^ 0x10]) + whole[at + 1 :])
    refused(tmp_path / "bent.png")


@FILES
@given(st.binary(max_size=200))
@example(b"\x89PNG\r\n\x1a\n")
@example(b"\x89PNG")
@example(png_of(100_000, 100_000))
@example(png_of(0, 10))
def test_random_bytes_are_refused(tmp_path, data):
    (tmp_path / "noise.png").write_bytes(data)
    refused(tmp_path / "noise.png")


def test_the_way_out_is_said(encoded, tmp_path):
    assert "none.png: no such file" in refused(tmp_path / "none.png")
    (tmp_path / "empty.png").touch()
    assert "is empty: record or copy it again" in refused(tmp_path / "empty.png")
    (tmp_path / "folder.png").mkdir()
    assert "folder.png: is a folder" in refused(tmp_path / "folder.png")


def test_images_are_listed_by_name_and_others_left_out(tmp_path):
    for name in ("b.png", "a.JPG", "notes.txt", "c.jpeg"):
        (tmp_path / name).touch()
    assert [path.name for path in list_images(tmp_path)] == ["a.JPG", "b.png", "c.jpeg"]


def test_a_folder_without_images_is_refused(tmp_path):
    with pytest.raises(DatasetError, match="has no image"):
        list_images(tmp_path)
    with pytest.raises(DatasetError, match="no such folder"):
        list_images(tmp_path / "none")
