"""Random handling in the whole chain: host core, CAN bus, nodes and drives, with true or rendered contacts.

The runs are those of shake_random.py. In a gap the finger's frames are rejected, as blurred ones would be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from palpate_edge.common.contact import Contact, refused_contact
from palpate_host.common import rotation
from palpate_host.common.status import HostStatus
from palpate_host.config.control_config import ControlLaw
from palpate_host.service.host import load_hand
from palpate_twin.closed_loop.lockstep import START_US, LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import ContactSource, DomeContact
from palpate_twin.hand.engine import Engine
from palpate_twin.paper.shake import CHAIN_START_S, chain_contacts
from palpate_twin.paper.shake_random import RandomRun, RunKind, explanation, random_trial
from palpate_twin.paper.trial import SLID_M, make_engine
from palpate_twin.paper.trial_parameters import Gap, Trial, after, trial_config, with_disturbances

FEWEST_TIPS = 2
"""Number of tips that hold an object at least."""


class GappedContacts:
    """Contacts of a source, except in the gaps of a trial that starts at start_us."""

    def __init__(self, source: ContactSource, gaps: Sequence[Gap], start_us: int) -> None:
        self._source, self._gaps, self._start_us = source, gaps, start_us

    def contact(self, finger: int, truth: DomeContact | None, exposed_at_us: int, sequence: int) -> Contact:
        """See :class:`ContactSource`."""
        time_s = 1e-6 * (exposed_at_us - self._start_us)
        if any(gap.finger == finger and gap.contains(time_s) for gap in self._gaps):
            return refused_contact(sequence, exposed_at_us, "gap of the trial", 0, 0)
        return self._source.contact(finger, truth, exposed_at_us, sequence)


class _Watch:
    """The true object and tips from the trial's start on, in each tick of the host."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._start_m, self._slip_m = engine.object_position_m, engine.slip_m.copy()
        self.ticks = 0
        self.held_tick = self.slid_tick = None  # type: int | None
        self.moved_m = self.normal_N = 0.0
        self.reason = ""

    @property
    def slip_m(self) -> float:
        return float((self._engine.slip_m - self._slip_m).max())

    def note(self, status: HostStatus) -> None:
        self.ticks += 1
        touching = [one.normal_force_N for one in self._engine.tip_contacts() if one is not None]
        self.normal_N = max(self.normal_N, *touching, 0.0)
        if len(touching) >= FEWEST_TIPS:
            self.held_tick, self.reason = self.ticks, status.reason
            self.moved_m = max(self.moved_m, rotation.norm(self._engine.object_position_m - self._start_m))
        if self.slid_tick is None and self.slip_m > SLID_M:
            self.slid_tick = self.ticks


def run_random_in_chain(
    hand_toml: Path, base: Trial, law: ControlLaw, number: int, sensors: Path | None
) -> RandomRun:
    """Run one of the random runs under one law in the whole chain. sensors: as for `shake.run_in_chain`."""
    return run_trial_in_chain(hand_toml, replace(random_trial(base, number), law=law), number, sensors)


def run_trial_in_chain(hand_toml: Path, trial: Trial, number: int, sensors: Path | None) -> RandomRun:
    """Run one trial with its delay and gaps in the whole chain.

    The object is lost when fewer than two tips touch it to the end of the run.
    """
    kind = RunKind.CHAIN if sensors is None else RunKind.FRAMES
    loaded, hand = load_hand(hand_toml)
    config = with_disturbances(trial_config(loaded, trial), after(trial.disturbances, CHAIN_START_S))
    engine = make_engine(config, "mujoco", has_B=False)
    start_us = START_US + round(1e6 * CHAIN_START_S)
    contacts = GappedContacts(chain_contacts(config, trial, sensors), trial.gaps, start_us)
    watch: _Watch | None = None

    def note(status: HostStatus) -> None:
        if watch is not None:
            watch.note(status)

    delay_us = round(1e6 * trial.delay_s)
    loop = LockstepLoop(config, hand, engine, contacts, trial.has_weight, on_tick=note, delay_us=delay_us)
    loop.run(CHAIN_START_S)
    watch = _Watch(engine)
    loop.run(trial.duration_s)
    tick_s = 1.0 / config.control.tick_Hz
    is_lost = watch.held_tick != watch.ticks
    why = "" if watch.slid_tick is None else explanation(trial, tick_s * watch.slid_tick)
    if is_lost and not why:
        why = watch.reason
    status = loop.status
    slips = max(status.hold.slips) if status is not None and status.hold is not None else 0
    return RandomRun(
        law=config.control.law,
        number=number,
        lost_s=tick_s * (watch.held_tick or 0) if is_lost else None,
        slip_mm=1e3 * watch.slip_m,
        moved_mm=1e3 * watch.moved_m,
        normal_N=watch.normal_N,
        slips=slips,
        explanation=why,
        kind=kind,
    )
