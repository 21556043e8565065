"""Appearance of beads: the channel on which they stand out, and the plane that is read from an image."""

from __future__ import annotations

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Image, Plane

CHANNELS: dict[str, tuple[float, float, float]] = {  # weights of B, G, R
    "grey": (0.114, 0.587, 0.299),
    "blue": (1.0, 0.0, 0.0),
    "green": (0.0, 1.0, 0.0),
    "red": (0.0, 0.0, 1.0),
    "blue-red": (0.5, 0.0, -0.5),
    "green-red": (0.0, 0.5, -0.5),
    "blue-green": (0.5, -0.5, 0.0),
}

GREY_PREFERENCE = (
    2.0  # a colour's beads must stand out that much more: grey decodes faster and has less noise
)


class Appearance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The channel on which beads stand out, and whether they are brighter than the skin there."""

    channel: str = "grey"
    bright: bool = False


def appearances(image: Image) -> list[Appearance]:
    """Return every way in which beads may stand out of an image."""
    channels = ["grey"] if image.ndim == 2 else list(CHANNELS)
    return [Appearance(channel, bright) for channel in channels for bright in (False, True)]


def plane(image: Image, appearance: Appearance) -> Plane:
    """Return the image's channel (height, width), signed so that beads are dark.

    The type is uint8 for grey, else float32.
    """
    if image.ndim == 2 or appearance.channel == "grey":
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return np.asarray(cv2.bitwise_not(grey) if appearance.bright else grey, dtype=np.uint8)
    sign = -1.0 if appearance.bright else 1.0
    weights = {index: sign * w for index, w in enumerate(CHANNELS[appearance.channel]) if w}
    first, *others = (cv2.extractChannel(image, index) for index in weights)
    if not others:
        return np.asarray(first, dtype=np.float32) * np.float32(sign)
    alpha, beta = weights.values()
    return np.asarray(cv2.addWeighted(first, alpha, others[0], beta, 0.0, dtype=cv2.CV_32F), np.float32)


def colour_weights(appearance: Appearance) -> tuple[float, float, float]:
    """Return the weights of B, G, R whose sum :func:`plane` is of a colour image."""
    blue, green, red = CHANNELS[appearance.channel]
    return (-blue, -green, -red) if appearance.bright else (blue, green, red)


def unlit_grey(appearance: Appearance) -> float | None:
    """Return the plane's value where no light falls; None for a difference of two colours.

    Such a difference is 0 in white light of any strength.
    """
    if "-" in appearance.channel:
        return None
    return 255.0 if appearance.bright and appearance.channel == "grey" else 0.0
