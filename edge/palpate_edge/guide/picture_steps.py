"""The first steps, on single pictures: focus, exposure, and the beads of the layout."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import CalibrationError
from palpate_edge.daemon.check_rows import DARK, MOST_SATURATED_SHARE, Verdict
from palpate_edge.geometry.sensor import Sensor
from palpate_edge.guide.guide_view import Judgement
from palpate_edge.setup.exposure import propose_exposure_us
from palpate_edge.vision.picture_measure import SATURATED, sharpness
from palpate_edge.vision.registration import Registration, register

NEAR_BEST = 0.93  # of the largest sharpness seen
EXPLORED = 1.1  # largest over smallest sharpness, when the lens was turned
BLACK = 16  # grey level of a pixel without light
REGISTER_EVERY_S = 1.0  # recognising the layout takes some 0.1 s

NO_PICTURE = "no picture yet: see palpate-edge check"

Figures = list[tuple[str, str]]


class FocusStep:
    """Compares the sharpness with the largest one seen; the lens is turned meanwhile."""

    instruction = "Turn the lens through its sharpest point and back, until the sharpness is at its largest."

    def __init__(self, sensor: Sensor) -> None:
        self._size_px = sensor.image_size_px
        self._seen_px: tuple[int, int] | None = None
        self._sharpness, self._best, self._least = 0.0, 0.0, np.inf

    def frame(self, image: Image, _now_s: float) -> None:
        """Measure a picture."""
        self._seen_px = image.shape[1], image.shape[0]
        self._sharpness = sharpness(image)
        self._best, self._least = max(self._best, self._sharpness), min(self._least, self._sharpness)

    def judge(self) -> Judgement:
        """Judge size and sharpness."""
        if self._seen_px is None:
            return Judgement(Verdict.ABSENT, NO_PICTURE)
        if self._seen_px != self._size_px:
            seen, wanted = ("x".join(map(str, size)) for size in (self._seen_px, self._size_px))
            text = f"the camera gives {seen}, sensor.toml describes {wanted}: correct camera.width and height"
            return Judgement(Verdict.FAIL, text)
        if self._sharpness < NEAR_BEST * self._best:
            percent = 100 * self._sharpness / self._best
            return Judgement(Verdict.WARN, f"{percent:.0f} % of the best: turn the lens back")
        if self._best < EXPLORED * self._least:
            return Judgement(
                Verdict.WARN, "the sharpness has not changed: turn the lens, or go on if it is fixed"
            )
        return Judgement(Verdict.OK, "as sharp as it was at best")

    def figures(self) -> Figures:
        return [("sharpness", f"{self._sharpness:.3f}"), ("best", f"{self._best:.3f}")]


class ExposureStep:
    """Judges the share of pixels that are too bright or black, and proposes an exposure time."""

    instruction = "Nothing may be white, and the beads must stand out. Set the exposure or the LED level."

    def __init__(self, fps: float) -> None:
        """fps: frame rate, which limits the exposure time."""
        self._fps = fps
        self._brightness: float | None = None
        self._white = self._black = 0.0
        self._exposure_us = self._proposed_us = 0

    def frame(self, image: Image, _now_s: float, exposure_us: int = 0) -> None:
        """Measure a picture of this exposure time, 0 when it is unknown."""
        brightest = image if image.ndim == 2 else image.max(axis=2)
        self._brightness = float(image.mean())
        self._white = float((brightest >= SATURATED).mean())
        self._black = float((brightest < BLACK).mean())
        self._exposure_us = exposure_us
        self._proposed_us = propose_exposure_us(image, exposure_us, self._fps) if exposure_us else 0

    def judge(self) -> Judgement:
        """Judge the light."""
        if self._brightness is None:
            return Judgement(Verdict.ABSENT, NO_PICTURE)
        remedy = "capture.camera.exposure_us in the configuration, or the LED level"
        if self._proposed_us and self._proposed_us != self._exposure_us:
            remedy = f"capture.camera.exposure_us = {self._proposed_us}, now {self._exposure_us}"
        if self._white > MOST_SATURATED_SHARE:
            return Judgement(Verdict.WARN, f"{100 * self._white:.0f} % is overexposed: lower {remedy}")
        if self._brightness < DARK:
            return Judgement(Verdict.WARN, f"the picture is dark: raise {remedy}")
        return Judgement(Verdict.OK, "the light is right")

    def figures(self) -> Figures:
        return [
            ("brightness", f"{self._brightness or 0.0:.0f} of 255"),
            ("overexposed", f"{100 * self._white:.1f} %"),
            ("black", f"{100 * self._black:.0f} %"),
        ]


class BeadsStep:
    """Recognises the layout of sensor.toml once a second.

    registration: of the last picture that showed it, None before.
    """

    instruction = "The dome must be clean and untouched, and every bead in the picture."

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor
        self._next_s = -np.inf
        self._fault = ""
        self.registration: Registration | None = None

    def frame(self, image: Image, now_s: float) -> None:
        """Recognise the layout, at most once a second."""
        if now_s < self._next_s:
            return
        self._next_s = now_s + REGISTER_EVERY_S
        try:
            self.registration, self._fault = register(image, self._sensor), ""
        except CalibrationError as error:
            self.registration, self._fault = None, str(error)

    def judge(self) -> Judgement:
        """Judge the number of beads."""
        if self._fault:
            return Judgement(Verdict.FAIL, self._fault)
        if self.registration is None:
            return Judgement(Verdict.ABSENT, NO_PICTURE)
        seen = self.registration.seen
        if not seen.all():
            text = (
                f"{int((~seen).sum())} beads are not seen: clean the dome, look for glare, or go on without"
            )
            return Judgement(Verdict.WARN, text)
        return Judgement(Verdict.OK, "every bead of the layout is recognised")

    def figures(self) -> Figures:
        if self.registration is None:
            return [("beads", "none recognised")]
        seen, looks = self.registration.seen, self.registration.appearance
        kind = f"{'bright' if looks.bright else 'dark'} on {looks.channel}"
        return [("beads", f"{int(seen.sum())} of {len(seen)}"), ("they are", kind)]
