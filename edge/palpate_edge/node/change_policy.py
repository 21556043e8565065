"""The policy for changes: which objects a master may write in which NMT state, and how often; pure.

CiA 301 has no authentication: an SDO request names its receiver, not its sender. The policy therefore binds
changes to the NMT state. What a running hand relies on changes in PRE-OPERATIONAL only, and every master sees
in the heartbeat that the node is there.
"""

from __future__ import annotations

import msgspec

from palpate_edge.common.contact_quantities import AI_AUTOZERO
from palpate_edge.node.nmt import SDO_STATES, NmtState
from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

AT_REST = frozenset({NmtState.PRE_OPERATIONAL})
LSS_STATES = frozenset({NmtState.INITIALISING, NmtState.PRE_OPERATIONAL, NmtState.STOPPED})
"""The states in which LSS may configure and store a node id; CiA 305 serves LSS in every state."""


class Rate(msgspec.Struct, frozen=True):
    """Highest rate of writes: `burst` at once, and then one in `period_us`."""

    burst: int
    period_us: int


SAVES = Rate(burst=20, period_us=60_000_000)
"""Saves that write: 1010h, 1011h and LSS together. 1440 a day spare a memory card."""

TARES = Rate(burst=44, period_us=1_000_000)
"""Writes to 6125h: two for each channel. A slow press must not be tared away step by step."""


class Rule(msgspec.Struct, frozen=True):
    """The states in which objects with these indices may be written, and how often (None: any number)."""

    indices: range
    content: str
    states: frozenset[NmtState] = AT_REST
    rate: Rate | None = None


RULES = (
    Rule(range(0x1003, 0x1004), "error history", SDO_STATES),
    Rule(range(0x1005, 0x1008), "SYNC: COB-ID, period, window"),
    Rule(range(0x1010, 0x1012), "save and restore", rate=SAVES),
    Rule(range(0x1012, 0x1013), "TIME: COB-ID"),
    Rule(range(0x1013, 0x1014), "high-resolution time stamp", SDO_STATES),
    Rule(range(0x1014, 0x1016), "EMCY: COB-ID, inhibit time"),
    Rule(range(0x1016, 0x1017), "heartbeats that the node monitors"),
    Rule(range(0x1017, 0x1018), "heartbeat time", SDO_STATES),
    Rule(range(0x1019, 0x101A), "SYNC: counter overflow"),
    Rule(range(0x1020, 0x1021), "configuration signature"),
    Rule(range(0x1029, 0x102A), "behaviour after an error"),
    Rule(range(0x1400, 0x1C00), "PDOs: COB-ID, transmission type, times, mapping"),
    Rule(range(0x2003, 0x2004), "location", SDO_STATES),
    Rule(range(0x2030, 0x2031), "LED level", SDO_STATES),
    Rule(range(AI_AUTOZERO, AI_AUTOZERO + 1), "tare, while nothing touches", SDO_STATES, TARES),
)
"""One rule for each object of ``fingertip.eds`` that a master may write."""

OTHER_COMMUNICATION = Rule(range(0x1000, 0x2000), "other communication objects")
OTHER_DEVICE = Rule(range(0x2000, 0x10000), "other objects of the device", SDO_STATES)
RULE_OF = {index: rule for rule in RULES for index in rule.indices}


def rule_of(index: int) -> Rule:
    """Return the rule of an object. Other devices than a fingertip decide about their own objects."""
    other = OTHER_COMMUNICATION if index in OTHER_COMMUNICATION.indices else OTHER_DEVICE
    return RULE_OF.get(index, other)


def check_state(index: int, state: NmtState) -> None:
    """Raise SdoAbortError when the object may not be written in this state."""
    if state not in rule_of(index).states:
        raise SdoAbortError(AbortCode.DEVICE_STATE)


class WriteRates:
    """The latest writes by each rule that has a rate."""

    def __init__(self) -> None:
        self._paid_until_us: dict[Rule, int] = {}

    def take(self, now_us: int, index: int) -> None:
        """Count a write to the object. Raises SdoAbortError when there were too many, without counting it."""
        rule = rule_of(index)
        if rule.rate is None:
            return
        from_us = max(now_us, self._paid_until_us.get(rule, now_us))
        if from_us - now_us > (rule.rate.burst - 1) * rule.rate.period_us:
            raise SdoAbortError(AbortCode.LOCAL_CONTROL)
        self._paid_until_us[rule] = from_us + rule.rate.period_us
