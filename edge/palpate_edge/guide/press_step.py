"""The presses of the apex on a kitchen scale: which pictures are good, and whether there are enough."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.contact import Contact, Vector3
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.frame import Frame
from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.datasets.weights_table import LARGEST_G, WeightRow
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.guide.guide_view import Judgement
from palpate_edge.guide.picture_steps import Figures

PRESSES = 12
LEAST_RANGE = 4.0  # heaviest over lightest press
MOST_TILT_DEG = 15.0  # from the apex


class PressStep:
    """Takes a picture of the press on the dome, then its mass.

    rows: the presses so far; taken: a picture that waits for its mass.
    """

    instruction = (
        "Press the apex against the scale's pan, or put a weight on it. Hold still, take the picture, and "
        "enter what the scale shows. Press lightly at first, then harder each time."
    )

    def __init__(self, estimator: Estimator, rows: Sequence[WeightRow], names: set[str]) -> None:
        """names: of pictures that exist; new ones are added."""
        self._estimator, self._names = estimator, names
        self._newest: tuple[Image, Contact] | None = None
        self.rows = list(rows)
        self.taken: Image | None = None

    def frame(self, image: Image, now_s: float) -> None:
        """Look for a contact."""
        self._newest = image.copy(), self._estimator.estimate(Frame(image, round(1e6 * now_s), 0, ""))

    def take(self) -> None:
        """Keep the newest picture. Raises ConfigError when it does not show a press of the apex."""
        fault = self._fault()
        if fault:
            raise ConfigError(fault)
        assert self._newest is not None
        self.taken = self._newest[0]

    def weigh(self, mass_g: float) -> tuple[str, Image]:
        """Give the picture that was taken its mass; return its new name and the picture.

        Raises ConfigError for an impossible mass.
        """
        if not 0 < mass_g <= LARGEST_G:
            raise ConfigError(f"{mass_g:g} g is not a mass of a press: give more than 0, up to {LARGEST_G:g}")
        assert self.taken is not None
        image, self.taken = self.taken, None
        name = next(name for number in count(1) if (name := f"w-{number:02}.png") not in self._names)
        self._names.add(name)
        self.rows.append(WeightRow(name, mass_g))
        return name, image

    def undo(self) -> None:
        """Forget the picture that waits, else the last press."""
        if self.taken is not None:
            self.taken = None
        elif self.rows:
            self.rows.pop()

    def judge(self) -> Judgement:
        """Judge number and range of the presses."""
        masses_g = [row.mass_g for row in self.rows if row.mass_g]
        if self.taken is not None:
            return Judgement(Verdict.OK, "picture taken: how many grams does the scale show?")
        if not masses_g:
            return Judgement(Verdict.WARN, "without a press the calibration gives positions and no force")
        if len(masses_g) > 1 and max(masses_g) < LEAST_RANGE * min(masses_g):
            range_g = f"{min(masses_g):g} to {max(masses_g):g} g"
            text = f"all presses are alike, {range_g}: press lighter and harder too"
            return Judgement(Verdict.WARN, text)
        if len(masses_g) < PRESSES:
            return Judgement(Verdict.WARN, f"{len(masses_g)} of {PRESSES} presses: more make the force surer")
        return Judgement(Verdict.OK, f"{len(masses_g)} presses of {min(masses_g):g} to {max(masses_g):g} g")

    def figures(self) -> Figures:
        last = f"{self.rows[-1].mass_g:g} g" if self.rows else "–"
        return [("now", self._fault() or self._touch()), ("last press", last)]

    def _fault(self) -> str:
        """Return why the newest picture cannot be taken, empty when it can."""
        if self._newest is None:
            return "no picture yet"
        contact = self._newest[1]
        if not contact.valid:
            return contact.reason
        if not contact.in_contact or contact.position_mm is None:
            return "no contact: press harder"
        tilt_deg = _tilt_deg(contact.position_mm)
        if tilt_deg > MOST_TILT_DEG:
            return f"the contact is {tilt_deg:.0f} deg beside the apex: press the apex itself"
        return ""

    def _touch(self) -> str:
        assert self._newest is not None and self._newest[1].position_mm is not None
        return f"a contact {_tilt_deg(self._newest[1].position_mm):.0f} deg from the apex"


def _tilt_deg(position_mm: Vector3) -> float:
    return float(np.degrees(np.arctan2(np.hypot(*position_mm[:2]), position_mm[2])))
