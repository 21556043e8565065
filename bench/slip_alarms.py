"""False alarms of the fingertip's two slip detectors in random handling: ``python -m bench.slip_alarms``.

The runs are those of ``palpate-host simulate shake --random`` under the pose law. Contact places and forces
are the twin's with the estimator's noise, the beads those of handled_skin.py; the flags are those of slip.py
and slip_onset.py, as on a fingertip, and the hand answers them. A flag is false when the tip has not slid by
0.1 mm within the second before.
"""

from __future__ import annotations

import argparse
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat
from multiprocessing import get_context

from bench.handled_skin import HandledSkin
from palpate_edge.common.contact import Contact
from palpate_edge.estimation.slip import WINDOW_US, SlipDetector
from palpate_edge.estimation.slip_onset import LoadHistory, detect_onset
from palpate_host.config.control_config import ControlLaw, ControlMode
from palpate_host.service.host import load_hand
from palpate_twin.cli.options import PACKAGED
from palpate_twin.closed_loop.tactile_rendering import DomeContact, TrueContactSource
from palpate_twin.paper.shake_random import random_trial
from palpate_twin.paper.trial import TrialRun, trial_setup
from palpate_twin.paper.trial_parameters import Trial

SLID_MM = 0.1
RADIUS95 = 2.45
"""95 % radius over the standard deviation along each axis of a place on a surface."""
BASE = Trial(
    mode=ControlMode.PROPOSED,
    rpy_deg=(0.0, 0.0, 0.0),
    duration_s=5.0,
    noise_mm=0.25,
    force_noise=0.03,
    law=ControlLaw.POSE,
)


@dataclass(slots=True)
class Flags:
    """Frames with a flag of one run, and those of them that are false."""

    all: int = 0
    false: int = 0

    def count(self, is_flagged: bool, has_slid: bool) -> None:
        """Count one frame."""
        self.all += is_flagged
        self.false += is_flagged and not has_slid


class DetectingContacts(TrueContactSource):
    """True contacts with noise whose slip flags are the detectors'."""

    def __init__(self, radius_mm: float, noise_mm: float, seed: int, force_noise: float) -> None:
        """See TrueContactSource."""
        super().__init__(radius_mm, noise_mm, seed, force_noise, sees_slip=False)
        self._radius95_mm = RADIUS95 * noise_mm
        self._detectors: dict[int, SlipDetector] = {}
        self._loads: dict[int, LoadHistory] = {}
        self._skin = HandledSkin(radius_mm, seed)
        self._slid: dict[int, deque[tuple[int, float]]] = {}
        self.slides, self.onsets = Flags(), Flags()

    def contact(self, finger: int, truth: DomeContact | None, exposed_at_us: int, sequence: int) -> Contact:
        """See ContactSource."""
        found = super().contact(finger, truth, exposed_at_us, sequence)
        found = replace(found, radius95_mm=self._radius95_mm)
        is_slip = self._detectors.setdefault(finger, SlipDetector()).detect(found)
        begins = truth is not None and self._begins(finger, truth, found)
        past = self._slid.setdefault(finger, deque())
        past.append((exposed_at_us, 0.0 if truth is None else truth.slip_mm))
        while exposed_at_us - past[0][0] > WINDOW_US:
            past.popleft()
        has_slid = past[-1][1] - past[0][1] >= SLID_MM
        self.slides.count(is_slip, has_slid)
        self.onsets.count(begins, has_slid)
        return replace(found, slip=is_slip, slip_begins=begins)

    def _begins(self, finger: int, truth: DomeContact, found: Contact) -> bool:
        skin_mm = self._skin.mean_motion_mm(truth)
        self._loads[finger], begins = detect_onset(self._loads.get(finger, ()), found, skin_mm)
        return begins


@dataclass(frozen=True, slots=True)
class Alarms:
    """Flags of one run, and whether a tip slid by 1 mm."""

    slides: Flags
    onsets: Flags
    slid: bool


def run(number: int, frame_rate_Hz: float) -> Alarms:
    """Return the alarms of one random run."""
    loaded, hand = load_hand(PACKAGED["table4-wide"])
    trial = random_trial(replace(BASE, frame_rate_Hz=frame_rate_Hz), number)
    config, engine = trial_setup(loaded, "mujoco", trial)
    contacts = DetectingContacts(
        1e3 * config.control.tip_radius_m, trial.noise_mm, trial.seed, trial.force_noise
    )
    outcome = TrialRun(config, hand, engine, trial, contacts).run()
    return Alarms(contacts.slides, contacts.onsets, outcome.slid_s is not None)


def main() -> None:
    """Print the number of false flags in so many runs."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--runs", type=int, default=720)
    parser.add_argument("--frame-rate", type=float, default=BASE.frame_rate_Hz, help="frames a second")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        alarms = list(pool.map(run, range(options.runs), repeat(options.frame_rate)))
    minutes = options.runs * BASE.duration_s / 60.0
    slid = [one.slid for one in alarms]
    print(f"{minutes:.0f} min of random handling, {sum(slid)} runs with a slide of 1 mm")
    for name in ("slides", "onsets"):
        flags: list[Flags] = [getattr(one, name) for one in alarms]
        found = sum(one.all > 0 for one, has_slid in zip(flags, slid, strict=True) if has_slid)
        print(
            f"{name}: {sum(one.all for one in flags)} frames flagged,"
            f" {sum(one.false for one in flags)} of them false in {sum(one.false > 0 for one in flags)} runs;"
            f" {found} of the runs with a slide flagged"
        )


if __name__ == "__main__":
    main()
