"""False alarms of the fingertip's slip detector in random handling: ``python -m bench.slip_alarms``.

The runs are those of ``palpate-host simulate shake --random`` under the pose law. Contact places and forces
are the twin's with the estimator's noise; the flag is that of slip.py, as on a fingertip, and the hand
answers it. A flag is false when the tip has not slid by 0.1 mm within the detector's window.
"""

from __future__ import annotations

import argparse
from collections import deque
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context

from palpate_edge.common.contact import Contact
from palpate_edge.estimation.slip import WINDOW_US, SlipDetector
from palpate_host.config.hand_config import ControlLaw, ControlMode
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


class DetectingContacts(TrueContactSource):
    """True contacts with noise whose slip flag is the detector's."""

    def __init__(self, radius_mm: float, noise_mm: float, seed: int, force_noise: float) -> None:
        """See TrueContactSource."""
        super().__init__(radius_mm, noise_mm, seed, force_noise, sees_slip=False)
        self._radius95_mm = RADIUS95 * noise_mm
        self._detectors: dict[int, SlipDetector] = {}
        self._slid: dict[int, deque[tuple[int, float]]] = {}
        self.flags = self.false_flags = 0

    def contact(self, finger: int, truth: DomeContact | None, exposed_at_us: int, sequence: int) -> Contact:
        """See ContactSource."""
        found = super().contact(finger, truth, exposed_at_us, sequence)
        found = replace(found, radius95_mm=self._radius95_mm)
        is_slip = self._detectors.setdefault(finger, SlipDetector()).detect(found)
        past = self._slid.setdefault(finger, deque())
        past.append((exposed_at_us, 0.0 if truth is None else truth.slip_mm))
        while exposed_at_us - past[0][0] > WINDOW_US:
            past.popleft()
        self.flags += is_slip
        self.false_flags += is_slip and past[-1][1] - past[0][1] < SLID_MM
        return replace(found, slip=is_slip)


@dataclass(frozen=True, slots=True)
class Alarms:
    """Flags of one run, those of them that are false, and whether a tip slid by 1 mm."""

    flags: int
    false_flags: int
    slid: bool


def run(number: int) -> Alarms:
    """Return the alarms of one random run."""
    loaded, hand = load_hand(PACKAGED["table4-wide"])
    trial = random_trial(BASE, number)
    config, engine = trial_setup(loaded, "mujoco", trial)
    contacts = DetectingContacts(
        1e3 * config.control.tip_radius_m, trial.noise_mm, trial.seed, trial.force_noise
    )
    outcome = TrialRun(config, hand, engine, trial, contacts).run()
    return Alarms(contacts.flags, contacts.false_flags, outcome.slid_s is not None)


def main() -> None:
    """Print the number of false flags in so many runs."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--runs", type=int, default=720)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        alarms = list(pool.map(run, range(options.runs)))
    minutes = options.runs * BASE.duration_s / 60.0
    print(
        f"{minutes:.0f} min of random handling: {sum(one.flags for one in alarms)} frames flagged,"
        f" {sum(one.false_flags for one in alarms)} of them false in"
        f" {sum(one.false_flags > 0 for one in alarms)} runs;"
        f" {sum(one.slid for one in alarms)} runs with a slide of 1 mm,"
        f" {sum(one.slid and one.flags > 0 for one in alarms)} of them flagged"
    )


if __name__ == "__main__":
    main()
