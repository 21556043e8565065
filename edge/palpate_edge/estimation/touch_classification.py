"""Touch classification: whether a frame shows an untouched skin, a contact, or a knocked camera.

- Skin motion below the contact threshold times the noise of the frame's beads: nothing touches, the drift
  is followed.
- Above it, but common to all beads and no farther than drift can have moved since it was last followed:
  nothing touches either; a contact hid the drift and has ended. A large motion is followed at once. A faint
  contact at the apex displaces the beads almost in common as well, so a small motion is followed only after
  some frames in a row.
- Common to all beads and larger than that: the camera was knocked. The frame is rejected until the drift has
  caught up. Only before the first frame any common motion counts as drift: the calibration may be old.
- Anything else is a contact.
"""

from __future__ import annotations

from enum import Enum

from palpate_edge.estimation.drift import MAX_DENT_SHARE, Drift
from palpate_edge.estimation.skin_motion import Motion

MAX_DENT_NOISE = 0.5  # contact thresholds, of a common motion; frames of the sample stay below 0.41
STEADY_FRAMES = 5  # without contact in a row before a small motion above the threshold is followed
LARGE = 10.0  # contact thresholds: noise cannot hide the dent of a press in a motion of this size
KNOCKED = 4.0  # contact thresholds: no press of this size is mistaken for a common motion


class SkinState(Enum):
    """State of the whole skin in one frame."""

    UNTOUCHED = "untouched"
    TOUCHED = "touched"
    KNOCKED = "knocked"


class TouchClassifier:
    """Classifies one sensor's frames, and lets the drift follow the untouched ones."""

    def __init__(self, drift: Drift, threshold_px: float) -> None:
        """threshold_px: skin motion above which something touches."""
        self._drift = drift
        self._threshold_px = threshold_px
        self._last_us: int | None = None
        self._frames_without_contact = 0
        self._catching_up = False

    def classify(self, motion: Motion, exposed_at_us: int) -> SkinState:
        """Return the skin's state; motion: without the drift."""
        elapsed_s = 0.0 if self._last_us is None else max(0.0, 1e-6 * (exposed_at_us - self._last_us))
        self._last_us = exposed_at_us
        self._drift.elapse(elapsed_s)
        threshold_px = self._threshold_px * motion.noise
        above_threshold = motion.size_px > threshold_px
        state = self._state(motion, threshold_px) if above_threshold else SkinState.UNTOUCHED
        self._catching_up = state is SkinState.KNOCKED
        if state is SkinState.TOUCHED:
            self._frames_without_contact = 0
            return state
        self._frames_without_contact += 1
        large = motion.size_px > LARGE * threshold_px
        if not above_threshold or large or self._frames_without_contact > STEADY_FRAMES:
            self._drift.follow_motion(motion.split, elapsed_s, at_once=large)
        return state

    def _state(self, motion: Motion, threshold_px: float) -> SkinState:
        """Return the state of a skin whose motion is above the frame's threshold."""
        if motion.dent_size_px > MAX_DENT_NOISE * threshold_px + MAX_DENT_SHARE * motion.size_px:
            return SkinState.TOUCHED
        if self._drift.explains(motion.split.common_px):
            return SkinState.UNTOUCHED
        knocked = self._catching_up or motion.size_px > KNOCKED * threshold_px
        return SkinState.KNOCKED if knocked else SkinState.TOUCHED
