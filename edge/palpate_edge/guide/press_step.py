"""The presses, at the apex or through a jig: which pictures are good, and whether there are enough."""

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
from palpate_edge.guide.guide_view import GuideAction, GuideStep, Judgement
from palpate_edge.guide.picture_steps import Figures
from palpate_edge.jig.jig_plan import Hole

PRESSES = 12
LEAST_RANGE = 4.0  # heaviest over lightest press
MOST_OFF_DEG = 15.0  # from the apex, or from the jig's hole
SCALE_INSTRUCTION = (
    "Press the apex against the scale's pan, or put a weight on it. Hold still, take the picture, and enter "
    "what the scale shows. Press lightly at first, then harder each time."
)
BETTER_WAYS = "Known places give better positions: palpate-edge jig --help, palpate-edge press-rig --help."
TO_JIG, TO_SCALE = GuideAction("jig", "Use the jig"), GuideAction("scale", "Use the scale")


class PressStep:
    """Takes a picture of the press on the dome, then its mass.

    rows: the presses so far; taken: a picture that waits for its mass.
    """

    def __init__(
        self,
        estimator: Estimator,
        rows: Sequence[WeightRow],
        names: set[str],
        holes: Sequence[Hole] = (),
    ) -> None:
        """names: of pictures that exist; new ones are added. holes: of the sensor's jig, empty without."""
        self._estimator, self._names, self._holes = estimator, names, tuple(holes)
        self._uses_jig = bool(holes)
        self._newest: tuple[Image, Contact] | None = None
        self.rows = list(rows)
        self.taken: Image | None = None

    @property
    def title(self) -> str:
        """The step's title."""
        return "Presses through the jig" if self._uses_jig else GuideStep.PRESSES.value

    @property
    def instruction(self) -> str:
        """The next thing for the person to do."""
        hole = self._hole
        if hole is None:
            return SCALE_INSTRUCTION if self._holes else f"{SCALE_INSTRUCTION} {BETTER_WAYS}"
        return (
            f"Put the rod into hole {hole.number}, {hole.theta_deg:g} deg from the apex at azimuth "
            f"{hole.phi_deg:g} deg. Turn the fingertip until the rod stands upright and slides freely, put a "
            "weight on it, take the picture, and enter the mass of rod and weight."
        )

    @property
    def progress(self) -> tuple[int, int]:
        """Presses of the chosen way, and how many suffice: one for each hole, or those on the scale."""
        if not self._uses_jig:
            return sum(row.theta_deg is None for row in self.rows), PRESSES
        return sum(row.theta_deg is not None for row in self.rows), len(self._holes)

    @property
    def other_way(self) -> GuideAction | None:
        """The answer that changes between scale and jig; None without a jig."""
        if not self._holes:
            return None
        return TO_SCALE if self._uses_jig else TO_JIG

    def change_way(self) -> None:
        """Go on with the scale in place of the jig, or the other way round; all presses are kept."""
        self._uses_jig = not self._uses_jig

    @property
    def _hole(self) -> Hole | None:
        """The first of the holes with the fewest presses; None on the scale."""
        if not self._uses_jig:
            return None
        pressed = [(row.theta_deg, row.phi_deg) for row in self.rows]
        return min(self._holes, key=lambda hole: pressed.count((hole.theta_deg, hole.phi_deg)))

    def frame(self, image: Image, now_s: float) -> None:
        """Look for a contact."""
        self._newest = image.copy(), self._estimator.estimate(Frame(image, round(1e6 * now_s), 0, ""))

    def take(self) -> None:
        """Keep the newest picture. Raises ConfigError when it does not show the press that is wanted."""
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
        hole = self._hole
        self.rows.append(
            WeightRow(name, mass_g)
            if hole is None
            else WeightRow(name, mass_g, theta_deg=hole.theta_deg, phi_deg=hole.phi_deg)
        )
        return name, image

    def undo(self) -> None:
        """Forget the picture that waits, else the last press."""
        if self.taken is not None:
            self.taken = None
        elif self.rows:
            self.rows.pop()

    def judge(self) -> Judgement:
        """Judge number and range of the presses."""
        if self.taken is not None:
            asked = "are rod and weight" if self._uses_jig else "does the scale show"
            return Judgement(Verdict.OK, f"picture taken: how many grams {asked}?")
        masses_g = [row.mass_g for row in self.rows if row.mass_g]
        done, wanted = self.progress
        if not masses_g:
            return Judgement(Verdict.WARN, "without a press the calibration gives positions and no force")
        range_g = f"{min(masses_g):g} to {max(masses_g):g} g"
        if not self._uses_jig and len(masses_g) > 1 and max(masses_g) < LEAST_RANGE * min(masses_g):
            text = f"all presses are alike, {range_g}: press lighter and harder too"
            return Judgement(Verdict.WARN, text)
        if done < wanted:
            what = "position and force" if self._uses_jig else "the force"
            return Judgement(Verdict.WARN, f"{done} of {wanted} presses: more make {what} surer")
        return Judgement(Verdict.OK, f"{len(masses_g)} presses of {range_g}")

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
        hole, off_deg = self._hole, self._off_deg(contact.position_mm)
        if off_deg <= MOST_OFF_DEG:
            return ""
        if hole is None:
            return f"the contact is {off_deg:.0f} deg beside the apex: press the apex itself"
        return (
            f"the contact is {off_deg:.0f} deg beside hole {hole.number}: use that hole, and turn the jig's "
            "arrow to the right side of the picture"
        )

    def _touch(self) -> str:
        assert self._newest is not None and self._newest[1].position_mm is not None
        place = "the apex" if self._hole is None else f"hole {self._hole.number}"
        return f"a contact {self._off_deg(self._newest[1].position_mm):.0f} deg from {place}"

    def _off_deg(self, position_mm: Vector3) -> float:
        """Return the angle between a contact and the wanted place, seen from the dome's centre."""
        wanted = (0.0, 0.0, 1.0) if self._hole is None else self._hole.outward
        across, along = np.linalg.norm(np.cross(position_mm, wanted)), np.dot(position_mm, wanted)
        return float(np.degrees(np.arctan2(across, along)))
