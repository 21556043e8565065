"""Write a picture; the ending of its name selects the format."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2

from palpate_edge.common.arrays import Image
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import PalpateError


def write_picture(path: Path, picture: Image, error: type[PalpateError], options: Sequence[int] = ()) -> None:
    """Write a grey or BGR picture as .png, .jpg, ..., complete or not at all.

    options: pairs for cv2.imencode. Raises `error` when the name has no picture's ending or the file system
    refuses.
    """
    try:
        _, data = cv2.imencode(path.suffix, picture, options)
    except cv2.error:
        raise error(f"{path} cannot be written: give a name that ends in .png or .jpg") from None
    write_atomically(path, data.tobytes(), error)
