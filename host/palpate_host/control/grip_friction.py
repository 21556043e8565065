"""Friction of all tips of a grip, and which slips are answered with more grip."""

from __future__ import annotations

from dataclasses import replace

from palpate_host.common.tip_contact import TipContact
from palpate_host.config.control_config import PoseLawConfig
from palpate_host.control.tip_friction import ANSWER_US, TipFriction, friction_ratio


class GripFriction:
    """The friction estimates of one hand's tips.

    tips: by finger. Slip of several tips at a time is one slip.
    """

    def __init__(self, config: PoseLawConfig, fingers: int, tip_radius_m: float) -> None:
        """Start every tip with the friction of hand.toml."""
        self._config, self._tip_radius_m = config, tip_radius_m
        self.tips = [TipFriction(config.friction)] * fingers
        self._answered_until_us = 0

    @property
    def provided(self) -> list[float]:
        """The friction for which the grip provides at each tip: with the slip reflex the estimates."""
        if self._config.slip_reflex:
            return self.estimates
        return [self._config.friction] * len(self.tips)

    @property
    def estimates(self) -> list[float]:
        """The estimated friction of each tip."""
        return [tip.friction for tip in self.tips]

    @property
    def is_lowered(self) -> bool:
        """True while the slip reflex is on and slip lowers the estimate of a tip."""
        return self._config.slip_reflex and any(tip.is_lowered for tip in self.tips)

    def note(self, finger: int, contact: TipContact, *, is_held: bool) -> bool:
        """Take the contact of one finger, and return whether it shows a new slip.

        is_held: it holds the object. Before, tips slide as they take hold of it: this is no slip.
        """
        config = self._config
        ratio = friction_ratio(contact, self._tip_radius_m, config.tip_stiffness_N_m2)
        if not is_held:
            self.tips[finger] = TipFriction(config.friction, ratio=ratio)
            return False
        if contact.slip_begins and not config.onset_reflex:
            contact = replace(contact, slip_begins=False)
        before = self.tips[finger]
        self.tips[finger] = after = before.after_contact(contact, ratio)
        return after.slips > before.slips

    def takes_answer(self, received_at_us: int) -> bool:
        """Return whether a new slip that was received then is answered with more grip."""
        if not self._config.slip_reflex or received_at_us < self._answered_until_us:
            return False
        self._answered_until_us = received_at_us + ANSWER_US
        return True

    def recover(self, dt_s: float) -> None:
        """Let the estimates recover for dt_s from slips."""
        self.tips = [tip.after_tick(dt_s) for tip in self.tips]
