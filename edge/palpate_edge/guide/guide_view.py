"""View of the guide at one moment: step, verdict, figures and possible answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import msgspec

from palpate_edge.daemon.check_rows import Verdict


class GuideStep(Enum):
    """The steps in their order; the value is the title."""

    FOCUS = "Camera and focus"
    EXPOSURE = "Exposure"
    BEADS = "Beads"
    REFERENCE = "Untouched dome"
    WARM_UP = "Warm-up"
    PRESSES = "Presses on the scale"
    CALIBRATE = "Calibration"
    REPORT = "Result"


STEPS = tuple(GuideStep)


@dataclass(frozen=True, slots=True)
class Judgement:
    """A verdict on a step and its reason.

    OK: go on; WARN: going on is possible; FAIL: it is not; ABSENT: not yet.
    """

    verdict: Verdict
    text: str


class GuideAction(msgspec.Struct, frozen=True):
    """An answer that is possible now. label: for a button; unit: of the number that the answer needs, or
    empty."""

    name: str
    label: str
    unit: str = ""


class GuideView(msgspec.Struct, frozen=True, kw_only=True):
    """The guide at one moment.

    number, steps: this step of how many; figures: pairs of name and text; done, total: of the step's
    progress, total 0 without one; actions: the first is the usual one.
    """

    number: int
    steps: int
    title: str
    instruction: str
    verdict: Verdict
    text: str
    figures: list[tuple[str, str]]
    done: int
    total: int
    actions: list[GuideAction]
