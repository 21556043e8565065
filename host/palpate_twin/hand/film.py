"""Images and films of hand and object, rendered by MuJoCo with OpenGL or by the plain renderer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import mujoco
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.picture_file import write_picture
from palpate_twin.hand.plain_drawing import draw_plainly
from palpate_twin.hand.twin_model import TwinModel

PICTURE_PX = (480, 640)
FILM_QUALITY = 70


def draw_states(
    twin: TwinModel, states: Sequence[Array], size_px: tuple[int, int] = PICTURE_PX, *, plainly: bool = False
) -> list[Image]:
    """Render states of the model (qpos) as BGR images (height, width, 3), all from the same viewpoint.

    plainly: use the plain renderer, which needs no OpenGL. Raises ConfigError if OpenGL does not work.
    """
    model, data = twin.model, mujoco.MjData(twin.model)
    model.vis.headlight.ambient[:] = 0.5
    camera = mujoco.MjvCamera()
    data.qpos[:] = states[0]
    mujoco.mj_forward(model, data)
    _aim(camera, data)
    pictures = []
    if plainly:
        for qpos in states:
            data.qpos[:] = qpos
            mujoco.mj_kinematics(model, data)
            pictures.append(_bgr(draw_plainly(twin, data, camera, size_px)))
    else:
        try:
            with mujoco.Renderer(model, *size_px) as renderer:
                for qpos in states:
                    data.qpos[:] = qpos
                    mujoco.mj_forward(model, data)
                    renderer.update_scene(data, camera)
                    pictures.append(_bgr(renderer.render()))
        except Exception as exc:  # MuJoCo passes on any exception of the OpenGL binding
            raise ConfigError(
                f"rendering with OpenGL failed ({exc}): set MUJOCO_GL=egl or MUJOCO_GL=osmesa, "
                "or give --plain to `simulate film`"
            ) from exc
    return pictures


def write_grid(path: Path, pictures: Sequence[Image], columns: int) -> None:
    """Write images of one size as a grid; images that do not fill a row are left out.

    Raises ConfigError if `path` cannot be written.
    """
    rows = [pictures[i : i + columns] for i in range(0, len(pictures) - columns + 1, columns)]
    write_row(path, [np.vstack([np.hstack(row) for row in rows])])


def label(picture: Image, text: str) -> Image:
    """Return a copy of the image with a line of text in its upper left corner."""
    place, font = (12, 28), cv2.FONT_HERSHEY_SIMPLEX
    return np.asarray(cv2.putText(picture.copy(), text, place, font, 0.7, (60, 60, 60), 1, cv2.LINE_AA))


def write_row(path: Path, pictures: Sequence[Image]) -> None:
    """Write images side by side. Raises ConfigError if `path` cannot be written."""
    write_picture(path, np.hstack(pictures), ConfigError)


def write_film(path: Path, pictures: Sequence[Image], period_ms: int) -> None:
    """Write an animated WebP, which browsers play in a loop. Raises ConfigError if `path` is not writable."""
    animation = cv2.Animation()
    animation.frames = list(pictures)
    animation.durations = [period_ms] * len(pictures)
    if path.suffix.lower() != ".webp":
        raise ConfigError(f"{path} cannot be written: give a name that ends in .webp")
    _, data = cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, FILM_QUALITY])
    write_atomically(path, data.tobytes(), ConfigError)


def _bgr(picture: Image) -> Image:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), dtype=np.uint8)


def _aim(camera: mujoco.MjvCamera, data: mujoco.MjData) -> None:
    """Place the camera above and to the side so that hand and object fill the image."""
    places = data.xpos[1:]
    camera.lookat = places.mean(axis=0)
    camera.distance = 1.45 * float(np.ptp(places, axis=0).max())
    camera.azimuth, camera.elevation = 60.0, -35.0
