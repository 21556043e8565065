"""Some of the rendered pictures of a camera as JPEG files, for the film and the report."""

from __future__ import annotations

from pathlib import Path

import cv2

from palpate_edge.common.arrays import Image
from palpate_edge.common.atomic_write import make_folder
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.picture_file import write_picture

EVERY = 5  # frames from one picture to the next: 6 a second at 30 frames/s
LAST = 1800  # sequence number after which no picture is kept: a minute at 30 frames/s, 8 MB
QUALITY = (cv2.IMWRITE_JPEG_QUALITY, 80)


class PictureKeeper:
    """Writes each `EVERY`-th picture of one camera into a folder, named by its sequence number."""

    def __init__(self, folder: Path) -> None:
        """Make the folder. Raises ConfigError if it cannot be made."""
        make_folder(folder, ConfigError)
        self._folder = folder

    def keep(self, sequence: int, image: Image) -> None:
        """Write the picture if it is its turn. Raises ConfigError if the file system refuses."""
        if sequence % EVERY == 0 and sequence <= LAST:
            write_picture(self._folder / f"{sequence:06d}.jpg", image, ConfigError, QUALITY)


def kept_pictures(folder: Path) -> dict[int, Path]:
    """Return the kept pictures by sequence number; none where there is no such folder."""
    return {int(path.stem): path for path in folder.glob("*.jpg") if path.stem.isdecimal()}
