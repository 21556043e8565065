"""The guide as a state machine: frames, times and answers in; views and work for the caller out. Pure.

The caller carries out the work (:data:`Work`): it writes the files and fits the calibrations.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.datasets.weights_table import WeightRow
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.geometry.sensor import Sensor
from palpate_edge.guide.calibration_report import report_figures, report_judgement
from palpate_edge.guide.guide_view import STEPS, GuideAction, GuideStep, GuideView, Judgement
from palpate_edge.guide.picture_steps import BeadsStep, ExposureStep, Figures, FocusStep
from palpate_edge.guide.press_step import PressStep
from palpate_edge.guide.untouched_steps import MOST_DRIFT_PX, REFERENCE_FRAMES, ReferenceStep, WarmUpStep
from palpate_edge.jig.jig_plan import Hole

FEWEST_REFERENCES = 5
NEXT = GuideAction("next", "Next")
BACK = GuideAction("back", "Back to the presses")
RESTART = GuideAction("restart", "Start over")


@dataclass(frozen=True, slots=True)
class SaveReference:
    """Keep these pictures as the reference frames, in place of earlier ones."""

    images: tuple[Image, ...]


@dataclass(frozen=True, slots=True)
class SavePress:
    """Write the picture to frames/ under a name, if there is one; then the table of all presses."""

    rows: tuple[WeightRow, ...]
    name: str = ""
    image: Image | None = None


@dataclass(frozen=True, slots=True)
class FitCalibration:
    """Fit a calibration to what was saved, and call `CalibrationGuide.fitted` or `refused`.

    with_presses: False: to the reference frames alone, to see contacts while pressing.
    """

    with_presses: bool


Work = SaveReference | SavePress | FitCalibration
Present = FocusStep | ExposureStep | BeadsStep | ReferenceStep | WarmUpStep | PressStep


class CalibrationGuide:
    """The guide for one sensor.

    step: the present one. calibration: the result, once there is one.
    """

    def __init__(
        self,
        sensor: Sensor,
        references: int = 0,
        rows: Sequence[WeightRow] = (),
        names: Collection[str] = (),
        holes: Sequence[Hole] = (),
    ) -> None:
        """holes: of the sensor's jig, empty without one.

        references, rows: number of reference frames and presses that an earlier run saved; with enough of
        the former it goes on at the presses. names: of files that may not be overwritten."""
        self._sensor = sensor
        self._rows, self._names, self._holes = list(rows), set(names), tuple(holes)
        self._work: list[Work] = []
        self._is_warm = False
        self._fitted = (0, 1)
        self._fault = ""
        self._focus, self._exposure = FocusStep(sensor), ExposureStep(sensor.camera.fps)
        self._beads = BeadsStep(sensor)
        self._reference: ReferenceStep | None = None
        self._warm_up: WarmUpStep | None = None
        self._presses: PressStep | None = None
        self.step = GuideStep.FOCUS
        self.calibration: Calibration | None = None
        if references >= FEWEST_REFERENCES:
            self._is_warm = True
            self._fit(with_presses=False)

    def frame(self, image: Image, now_s: float, exposure_us: int = 0) -> None:
        """Take the next picture and its time; exposure_us: 0 when it is unknown."""
        present = self._present()
        if isinstance(present, ExposureStep):
            present.frame(image, now_s, exposure_us)
        elif present is not None:
            present.frame(image, now_s)

    def answer(self, name: str, number: float | None = None) -> None:
        """Take an answer. Raises ConfigError when it is not possible now, with the reason."""
        action = next((one for one in self._actions() if one.name == name), None)
        if action is None:
            possible = ", ".join(one.name for one in self._actions()) or "none"
            raise ConfigError(f"{name} is not possible now; possible answers: {possible}")
        if action.unit and number is None:
            raise ConfigError(f"{name} needs a number in {action.unit}")
        match name:
            case "next":
                self._next()
            case "restart":
                self._restart()
            case "back":
                self._fault, self.step = "", GuideStep.PRESSES
            case "take" if self._presses is not None:
                self._presses.take()
            case "mass" if self._presses is not None and number is not None:
                frame, image = self._presses.weigh(number)
                self._work.append(SavePress(tuple(self._presses.rows), frame, image))
            case "jig" | "scale" if self._presses is not None:
                self._presses.change_way()
            case "undo" if self._presses is not None:
                self._presses.undo()
                self._work.append(SavePress(tuple(self._presses.rows)))

    def take_work(self) -> list[Work]:
        """Return what the caller has to do now, in this order."""
        work, self._work = self._work, []
        return work

    def progress(self, done: int, total: int) -> None:
        """Take note of how far a fit is."""
        self._fitted = done, total

    def fitted(self, calibration: Calibration) -> None:
        """Take the calibration that was fitted."""
        if self.step is GuideStep.CALIBRATE:
            self.calibration, self.step = calibration, GuideStep.REPORT
            return
        estimator = Estimator(calibration)
        self._presses = PressStep(estimator, self._rows, self._names, self._holes)
        self._warm_up = None if self._is_warm else WarmUpStep(estimator)
        self.step = GuideStep.PRESSES if self._is_warm else GuideStep.WARM_UP

    def refused(self, reason: str) -> None:
        """Take note that no calibration could be fitted."""
        self._fault = reason

    def view(self) -> GuideView:
        """Return what a person sees now."""
        present, judgement, (done, total) = self._present(), self._judge(), self._progress()
        return GuideView(
            number=STEPS.index(self.step) + 1,
            steps=len(STEPS),
            title=present.title if isinstance(present, PressStep) else self.step.value,
            instruction=self._instruction(),
            verdict=judgement.verdict,
            text=judgement.text,
            figures=self._figures(),
            done=done,
            total=total,
            actions=self._actions(),
        )

    def _next(self) -> None:
        judgement = self._judge()
        if judgement.verdict in (Verdict.FAIL, Verdict.ABSENT):
            raise ConfigError(judgement.text)
        match self.step:
            case GuideStep.FOCUS | GuideStep.EXPOSURE:
                self.step = STEPS[STEPS.index(self.step) + 1]
            case GuideStep.BEADS:
                self._begin_reference()
            case GuideStep.REFERENCE if self._reference is not None:
                self._work.append(SaveReference(tuple(self._reference.images)))
                self._reference = None
                self._fit(with_presses=False)
            case GuideStep.WARM_UP if self._warm_up is not None:
                self._is_warm = True
                if self._warm_up.drift_px > MOST_DRIFT_PX:
                    self._begin_reference()
                else:
                    self.step = GuideStep.PRESSES
            case GuideStep.PRESSES if self._presses is not None:
                self._rows = self._presses.rows
                self.step = GuideStep.CALIBRATE
                self._fit(with_presses=True)

    def _begin_reference(self) -> None:
        assert self._beads.registration is not None
        self._reference, self.step = ReferenceStep(self._beads.registration), GuideStep.REFERENCE

    def _restart(self) -> None:
        """Start over; the caller keeps the earlier files under other names when new ones are saved."""
        self._rows, self._is_warm, self._fault = [], False, ""
        self._focus, self._beads = FocusStep(self._sensor), BeadsStep(self._sensor)
        self._presses = self._warm_up = self.calibration = None
        self.step = GuideStep.FOCUS

    def _fit(self, *, with_presses: bool) -> None:
        self._fault, self._fitted = "", (0, 1)
        self._work.append(FitCalibration(with_presses))
        if not with_presses:
            self.step = GuideStep.REFERENCE

    def _present(self) -> Present | None:
        """Return the step that looks at pictures now; None while a calibration is fitted, and at the end."""
        steps: dict[GuideStep, Present | None] = {
            GuideStep.FOCUS: self._focus,
            GuideStep.EXPOSURE: self._exposure,
            GuideStep.BEADS: self._beads,
            GuideStep.REFERENCE: self._reference,
            GuideStep.WARM_UP: self._warm_up,
            GuideStep.PRESSES: self._presses,
        }
        return steps.get(self.step)

    def _judge(self) -> Judgement:
        if self._fault:
            return Judgement(Verdict.FAIL, self._fault)
        present = self._present()
        if present is not None:
            return present.judge()
        if self.calibration is not None and self.step is GuideStep.REPORT:
            return report_judgement(self.calibration)
        return Judgement(Verdict.ABSENT, "computing")

    def _instruction(self) -> str:
        present = self._present()
        if present is not None:
            return present.instruction
        return "" if self.step is GuideStep.REPORT else "The calibration is computed: some seconds."

    def _figures(self) -> Figures:
        present = self._present()
        if present is not None:
            return present.figures()
        return [] if self.calibration is None else report_figures(self.calibration)

    def _progress(self) -> tuple[int, int]:
        match self._present():
            case ReferenceStep() as reference:
                return len(reference.images), REFERENCE_FRAMES
            case PressStep() as presses:
                return presses.progress
            case None if self.step is not GuideStep.REPORT:
                return self._fitted
        return 0, 0

    def _actions(self) -> list[GuideAction]:
        present = self._present()
        if isinstance(present, PressStep):
            return _press_actions(present)
        if present is not None:
            return [NEXT]
        if self._fault and self.step is GuideStep.CALIBRATE:
            return [BACK, RESTART]
        return [RESTART] if self._fault or self.step is GuideStep.REPORT else []


def _press_actions(presses: PressStep) -> list[GuideAction]:
    if presses.taken is not None:
        return [GuideAction("mass", "Enter the grams", "g"), GuideAction("undo", "Discard the picture")]
    undo = [GuideAction("undo", "Delete the last press")] if presses.rows else []
    way = [presses.other_way] if presses.other_way is not None else []
    return [GuideAction("take", "Take the picture"), GuideAction("next", "Calibrate"), *undo, *way, RESTART]
