"""Earlier versions of ``fingertip.eds`` of which the present one has every object unchanged.

What was made with one of them is still valid: parameters that a fingertip stored, and recorded bus logs. A
version that only adds objects appends a line here; one that changes or removes an object begins a new list.
"""

from __future__ import annotations

import msgspec


class EarlierEds(msgspec.Struct, frozen=True):
    """One version. checksum: as in `ParsedEds`. meaning: as in a log's header, ``eds.fingertip.meaning``."""

    checksum: str
    meaning: str


EARLIER = (
    EarlierEds("b873fba4c3745a2b", "34eb440c8f525375"),  # without CAN FD: 1809h, 1A09h, 2005h
    EarlierEds("897e86cd4d046efd", "adb6add03196e23f"),  # bit 5 of 2010h not in its comment
)
