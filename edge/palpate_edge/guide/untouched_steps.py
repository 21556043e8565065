"""The steps with the dome untouched: its reference frames, and the warm-up until the picture stands still."""

from __future__ import annotations

from collections import deque

import numpy as np

from palpate_edge.calibration.reference_frames import compare_references
from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.frame import Frame
from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.geometry.points import spacing
from palpate_edge.guide.guide_view import Judgement
from palpate_edge.guide.picture_steps import Figures
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.registration import Registration
from palpate_edge.vision.subpixel import Refiner

REFERENCE_FRAMES = 20
REFERENCE_EVERY_S = 0.2
STILL_PX = 0.3  # median shift of the beads from the first reference frame
WINDOW_S = 30.0  # in which the drift is judged
WARM_PX = 0.1  # change of the drift within it
MOST_DRIFT_PX = 0.3  # from the reference frames; beyond it they are taken again


class ReferenceStep:
    """Takes pictures of the untouched dome; begins again when the beads move.

    Pictures that differ from the others, as by a touch, are taken again. images: the pictures so far.
    """

    instruction = "Touch neither the dome nor the camera. The pictures are taken by themselves."

    def __init__(self, registration: Registration) -> None:
        self._registration = registration
        self._refiner = Refiner(registration.diameter_px, spacing(registration.position_px))
        self._first_px: Array | None = None
        self._next_s, self._moved_px, self._restarts = -np.inf, 0.0, 0
        self._places_px: list[Array] = []
        self._fault = ""
        self.images: list[Image] = []

    def frame(self, image: Image, now_s: float) -> None:
        """Keep a picture, every `REFERENCE_EVERY_S`."""
        if now_s < self._next_s or self.is_complete:
            return
        self._next_s = now_s + REFERENCE_EVERY_S
        registration = self._registration
        dark = plane(image, registration.appearance)
        place_px = self._refiner.refine(dark, registration.position_px).position_px
        if self._first_px is None:
            self._first_px = place_px
        shift_px = np.linalg.norm((place_px - self._first_px)[registration.seen], axis=1)
        self._moved_px = float(np.median(shift_px))
        if self._moved_px > STILL_PX:
            self._first_px, self.images, self._places_px = None, [], []
            self._restarts += 1
            return
        self.images.append(image.copy())
        self._places_px.append(place_px[registration.seen])
        if len(self.images) == REFERENCE_FRAMES:
            self._leave_out_faults()

    def _leave_out_faults(self) -> None:
        """Leave out the pictures that differ from the others, to be taken again."""
        faults = compare_references(np.array(self._places_px))
        wrong = sorted({*faults.touched.tolist(), *faults.moved.tolist()})
        if not wrong:
            return
        what = "the dome was touched" if len(faults.touched) else "the camera or the sensor moved"
        numbers = ", ".join(str(index + 1) for index in wrong)
        self._fault = f"; pictures {numbers} differed from the others and are taken again: {what}"
        kept = [index for index in range(len(self.images)) if index not in wrong]
        self.images = [self.images[index] for index in kept]
        self._places_px = [self._places_px[index] for index in kept]

    @property
    def is_complete(self) -> bool:
        return len(self.images) == REFERENCE_FRAMES

    def judge(self) -> Judgement:
        """Judge the number of pictures."""
        if self.is_complete:
            text = f"{REFERENCE_FRAMES} pictures of the untouched dome{self._fault}"
            return Judgement(Verdict.WARN if self._fault else Verdict.OK, text)
        again = f" (begun {self._restarts + 1} times, since the beads moved)" if self._restarts else ""
        return Judgement(
            Verdict.ABSENT, f"{len(self.images)} of {REFERENCE_FRAMES} pictures{again}{self._fault}"
        )

    def figures(self) -> Figures:
        return [("beads moved", f"{self._moved_px:.2f} px")]


class WarmUpStep:
    """Follows the drift of the untouched dome since the reference frames.

    drift_px: root mean square over the beads. seconds: since the step began.
    """

    instruction = "Leave the light on and the dome untouched until the picture drifts no more: some minutes."

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._history: deque[tuple[float, float]] = deque()
        self._begun_s: float | None = None
        self._reason = ""
        self.seconds = self.drift_px = 0.0

    def frame(self, image: Image, now_s: float) -> None:
        """Measure the drift."""
        self._begun_s = now_s if self._begun_s is None else self._begun_s
        self.seconds = now_s - self._begun_s
        contact = self._estimator.estimate(Frame(image, round(1e6 * now_s), 0, ""))
        self._reason = contact.reason or ("something touches the dome" if contact.in_contact else "")
        self.drift_px = self._estimator.health.drift_px
        self._history.append((now_s, self.drift_px))
        while now_s - self._history[0][0] > WINDOW_S:
            self._history.popleft()

    def judge(self) -> Judgement:
        """Judge the drift of the last `WINDOW_S`."""
        if self._reason:
            return Judgement(Verdict.WARN, self._reason)
        if self.seconds < WINDOW_S:
            return Judgement(Verdict.WARN, f"measuring for {WINDOW_S:.0f} s")
        if self._change_px > WARM_PX:
            return Judgement(Verdict.WARN, "the picture still drifts: wait")
        return Judgement(Verdict.OK, "warm: the picture stands still")

    @property
    def _change_px(self) -> float:
        drifts = [drift_px for _, drift_px in self._history]
        return max(drifts) - min(drifts) if drifts else 0.0

    def figures(self) -> Figures:
        return [
            ("time", f"{self.seconds:.0f} s"),
            ("drift", f"{self.drift_px:.2f} px"),
            (f"change in {WINDOW_S:.0f} s", f"{self._change_px:.2f} px"),
        ]
