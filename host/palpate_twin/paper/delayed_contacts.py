"""Contacts of the simulated fingertips as the controller gets them: at their frame rate, late, with gaps."""

from __future__ import annotations

from collections import deque

from palpate_edge.common.contact import Contact
from palpate_host.common.tip_contact import TipContact
from palpate_host.control.kinematics import HandKinematics, HandPose
from palpate_host.control.manipulation import Manipulation
from palpate_twin.closed_loop.tactile_rendering import ContactSource, dome_contacts
from palpate_twin.hand.engine import Engine, LostGraspError
from palpate_twin.paper.trial_parameters import Trial


class DelayedContacts:
    """The frames under way; `gaps` of the trial count from start_s."""

    def __init__(
        self, engine: Engine, hand: HandKinematics, trial: Trial, contacts: ContactSource, start_s: float
    ) -> None:
        self._engine, self._hand, self._trial = engine, hand, trial
        self._contacts, self._start_s = contacts, start_s
        self._frames = 0
        self._delayed: deque[tuple[float, int, TipContact, HandPose]] = deque()

    def expose(self, now_s: float, pose: HandPose, *, may_lift: bool = False) -> None:
        """Expose a frame of every fingertip if it is due.

        Raises LostGraspError when a tip touches nothing, unless fingers may be lifted.
        """
        if now_s < self._frames / self._trial.frame_rate_Hz - 1e-9:
            return
        exposed_us = round(now_s * 1e6)
        for finger, truth in enumerate(dome_contacts(self._engine, self._hand)):
            if truth is None and not may_lift:
                raise LostGraspError(
                    f"tip {finger + 1} lost contact with the object at {self._engine.time_s:.2f} s:"
                    " increase the grasping force or turn more slowly"
                )
            found = self._contacts.contact(finger, truth, exposed_us, self._frames)
            gaps = [gap for gap in self._trial.gaps if gap.finger == finger]
            if not any(gap.contains(now_s - self._start_s) for gap in gaps):
                contact = self._tip_contact(found, exposed_us)
                self._delayed.append((now_s + self._trial.delay_s, finger, contact, pose))
        self._frames += 1

    def deliver(self, now_s: float, control: Manipulation) -> None:
        """Give the controller the contacts that have arrived."""
        while self._delayed and self._delayed[0][0] <= now_s + 1e-9:
            _, finger, contact, pose = self._delayed.popleft()
            control.add_contact(finger, contact, pose)

    def _tip_contact(self, found: Contact, exposed_us: int) -> TipContact:
        return TipContact(
            received_at_us=exposed_us + round(self._trial.delay_s * 1e6),
            exposed_at_us=exposed_us,
            sequence=self._frames,
            latency_us=0,
            position_mm=found.position_mm,
            normal_force_N=found.normal_force_N,
            shear_N=None if found.shear_N is None else found.shear_N[:2],
            torsion_Nmm=found.torsion_Nmm,
            valid=True,
            in_contact=found.in_contact,
            slip=found.slip,
            slip_begins=found.slip_begins,
            quality=255,
        )
