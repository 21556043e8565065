"""Fault injection on the bus: pure and seeded, so that a run with faults can be repeated.

A fault acts between a sender and the wire: the frame is dropped, duplicated, delayed or refused, or the
sender's port is bus-off. Later frames may overtake a delayed frame, so a random delay reorders frames.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from random import Random
from typing import Annotated

import msgspec

from palpate_edge.can_bus.can_frame import MAX_STANDARD_ID, CanFrame
from palpate_edge.common.errors import ConfigError

MAX_DELAY_US = 10_000_000
MAX_RULES = 64
MAX_COPIES = 16  # of one frame, when several DUPLICATE rules apply to it


class FaultKind(Enum):
    """Kinds of injected faults."""

    DROP = "drop"
    DUPLICATE = "duplicate"
    DELAY = "delay"
    TX_FULL = "tx-full"
    BUS_OFF = "bus-off"


_Standard = Annotated[int, msgspec.Meta(ge=0, le=MAX_STANDARD_ID)]
_Delay = Annotated[int, msgspec.Meta(ge=0, le=MAX_DELAY_US)]


class FaultRule(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One fault and the frames it applies to.

    port: the sender, None for every port. can_id, mask: the identifiers, equal to can_id in the bits of mask;
    can_id None for every identifier.
    probability: 0 to 1, drawn for each frame by a generator seeded with `seed`.
    count: number of hits after which the rule ends; None for no limit.
    start_us, duration_us: time window after the injection; duration None lasts until cleared.
    delay_us, delay_max_us: DELAY holds a frame for delay_us, or for a uniform time up to delay_max_us.
    BUS_OFF needs a port, takes no identifier, probability or count, and ends with its window.
    """

    kind: FaultKind
    port: str | None = None
    can_id: _Standard | None = None
    mask: _Standard = MAX_STANDARD_ID
    probability: Annotated[float, msgspec.Meta(ge=0, le=1)] = 1.0
    count: Annotated[int, msgspec.Meta(ge=1)] | None = None
    start_us: Annotated[int, msgspec.Meta(ge=0)] = 0
    duration_us: Annotated[int, msgspec.Meta(ge=1)] | None = None
    delay_us: _Delay = 0
    delay_max_us: _Delay | None = None
    seed: int = 0

    def check(self) -> None:
        """Raise ConfigError when the fields contradict each other."""
        if self.kind is FaultKind.BUS_OFF:
            if self.port is None:
                raise ConfigError("fault bus-off needs a port: add for example --port finger-1")
            if self.can_id is not None or self.count is not None or self.probability != 1.0:
                raise ConfigError(
                    "fault bus-off takes a port and a time window only: omit id, count and probability"
                )
        if self.kind is not FaultKind.DELAY and (self.delay_us or self.delay_max_us is not None):
            raise ConfigError(f"fault {self.kind.value} takes no delay: use kind delay, or omit the delay")
        if self.delay_max_us is not None and self.delay_max_us < self.delay_us:
            raise ConfigError(
                f"fault delay: maximum {self.delay_max_us} us is below minimum {self.delay_us} us: swap them"
            )


@dataclass(frozen=True, slots=True)
class Fate:
    """Effect of all faults on a frame: refused, or sent once after each of the delays (none: dropped)."""

    refused: bool = False
    delays_us: tuple[int, ...] = (0,)


UNHARMED = Fate()


@dataclass(slots=True)
class _Active:
    rule: FaultRule
    from_us: int
    until_us: int | None
    random: Random = field(init=False)
    hits: int = 0

    def __post_init__(self) -> None:
        self.random = Random(self.rule.seed)

    def over(self, now_us: int) -> bool:
        return (self.until_us is not None and now_us >= self.until_us) or self.hits == self.rule.count

    def matches(self, port: str, frame: CanFrame, now_us: int) -> bool:
        rule = self.rule
        return (
            now_us >= self.from_us
            and not self.over(now_us)
            and rule.port in (None, port)
            and (rule.can_id is None or (rule.can_id ^ frame.can_id) & rule.mask == 0)
        )

    def strikes(self) -> bool:
        if self.rule.probability < 1.0 and self.random.random() >= self.rule.probability:
            return False
        self.hits += 1
        return True


class FaultPlan:
    """All active and scheduled faults."""

    def __init__(self) -> None:
        self._active: list[_Active] = []

    def inject(self, rule: FaultRule, now_us: int) -> None:
        """Add a rule.

        Raises ConfigError when its fields contradict each other or there are too many rules.
        """
        rule.check()
        if len(self._active) == MAX_RULES:
            raise ConfigError(
                f"{MAX_RULES} faults are active, which is the maximum: clear them first:"
                " palpate-host bus fault clear"
            )
        from_us = now_us + rule.start_us
        until_us = None if rule.duration_us is None else from_us + rule.duration_us
        self._active.append(_Active(rule, from_us, until_us))

    def clear(self) -> None:
        """End every rule."""
        self._active.clear()

    def rules(self) -> list[tuple[FaultRule, int]]:
        """Return the active and scheduled rules, each with the number of frames it has affected."""
        return [(active.rule, active.hits) for active in self._active]

    def fate(self, port: str, frame: CanFrame, verdict_wanted: bool, now_us: int) -> Fate:
        """Return the effect on `frame`, sent by `port` now. Rules act in the order of their injection.

        verdict_wanted: the sender waits for the verdict. TX_FULL refuses only such frames, because otherwise
        the sender would not learn of the refusal.
        """
        if not self._active:
            return UNHARMED
        delays_us = [0]
        harmed = False
        for active in self._active:
            kind = active.rule.kind
            if kind is FaultKind.BUS_OFF or (kind is FaultKind.TX_FULL and not verdict_wanted):
                continue
            if not active.matches(port, frame, now_us) or not active.strikes():
                continue
            harmed = True
            if kind is FaultKind.TX_FULL:
                return Fate(refused=True, delays_us=())
            if kind is FaultKind.DROP:
                return Fate(delays_us=())
            if kind is FaultKind.DUPLICATE:
                delays_us = (delays_us + delays_us)[:MAX_COPIES]
            else:
                delays_us = [delay + _delay_us(active) for delay in delays_us]
        return Fate(delays_us=tuple(delays_us)) if harmed else UNHARMED

    def is_bus_off(self, port: str, now_us: int) -> bool:
        """Return whether the port is bus-off now."""
        return any(
            active.rule.kind is FaultKind.BUS_OFF
            and active.rule.port == port
            and active.from_us <= now_us
            and not active.over(now_us)
            for active in self._active
        )

    def wants_verdicts(self, port: str) -> bool:
        """Return whether a TX_FULL rule may refuse frames of this port, now or later."""
        return any(
            active.rule.kind is FaultKind.TX_FULL and active.rule.port in (None, port)
            for active in self._active
        )

    def expire(self, now_us: int) -> None:
        """Remove the rules that have ended."""
        self._active = [active for active in self._active if not active.over(now_us)]

    def next_edge_us(self, now_us: int) -> int | None:
        """Return the time at which the next window opens or closes, None when none does."""
        edges = [active.from_us for active in self._active if active.from_us > now_us]
        edges += [active.until_us for active in self._active if active.until_us is not None]
        return min(edges, default=None)


def _delay_us(active: _Active) -> int:
    rule = active.rule
    if rule.delay_max_us is None:
        return rule.delay_us
    return active.random.randint(rule.delay_us, rule.delay_max_us)
