"""The event of the page that shows a hand: a status, live or of a recording, and the hand drawn from it."""

from __future__ import annotations

import msgspec

from palpate_host.common.status import HostStatus
from palpate_host.console.hand_scene import HandScene


class HandNews(msgspec.Struct, frozen=True):
    """A status and its hand. scene: None while a joint's position is not known. recording: the name of the
    recording that the status is from, empty for the live hand; at_s: time since the recording's beginning."""

    status: HostStatus
    scene: HandScene | None
    recording: str = ""
    at_s: float = 0.0
