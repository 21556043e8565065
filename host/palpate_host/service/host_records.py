"""The host's records in a bus log: notes of what is not on the bus, written with the frames and read back.

| kind | text |
|---|---|
| input | an operator's command, a request to end, a loss or return of the bus, before the tick that follows |
| tick | the host's status without what the frames contain; after the first, only the keys that changed |

Joint positions, torques, commands and contacts are in the frames and are not repeated, except a command whose
drive does not carry it as a torque in RPDO 1.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from palpate_bus.logs.candump import LogError, LogNote
from palpate_host.common.joint_command import Follows
from palpate_host.common.status import HostStatus
from palpate_host.common.tick_inputs import HostInput, TickInputs
from palpate_host.config.hand_config import HandConfig
from palpate_host.drives.identify import SDO_REQUEST_ID
from palpate_host.drives.registry import CIA402
from palpate_host.network.nmt_master import NMT_ID

INPUT, TICK = "input", "tick"
SDO_REQUEST_IDS = range(SDO_REQUEST_ID + 1, SDO_REQUEST_ID + 0x80)
IN_FRAMES = ("fingers", "joints", "R_vir", "inputs")
"""Fields of the status that a tick's note leaves out: frames, kinematics, and notes of kind input."""


@dataclass(frozen=True, slots=True)
class TickRecord:
    """One recorded tick.

    status: the host's status without fingers, joints and R_vir. unpaired: of each finger. command_Nm: of each
    joint, None where RPDO 1 carries it.
    """

    status: HostStatus
    inputs: TickInputs
    unpaired: tuple[int, ...]
    command_Nm: tuple[float, ...] | None


def commands_are_torques(config: HandConfig) -> bool:
    """Return whether RPDO 1 of every drive carries the commanded torque."""
    is_torque = config.control.drives_follow is Follows.TORQUE
    return is_torque and all(joint.drive == CIA402 for joint in config.joints)


class HostRecorder:
    """Makes the notes of one log."""

    def __init__(self, config: HandConfig) -> None:
        self._has_torques = commands_are_torques(config)
        self._last: dict[str, Any] = {}

    def notes(self, status: HostStatus) -> list[LogNote]:
        """Return the notes of a tick: its inputs, then the tick. A tick without inputs has no notes."""
        inputs = status.inputs
        if inputs is None:
            return []
        state = _state(status, inputs)
        if not self._has_torques:
            state["command_Nm"] = [joint.command_Nm for joint in status.joints]
        changed = {key: value for key, value in state.items() if self._last.get(key, _ABSENT) != value}
        self._last = state
        events = [
            LogNote(inputs.called_us, INPUT, _text(msgspec.to_builtins(event))) for event in inputs.events
        ]
        return [*events, LogNote(inputs.called_us, TICK, _text(changed))]


_ABSENT = object()


def _state(status: HostStatus, inputs: TickInputs) -> dict[str, Any]:
    state: dict[str, Any] = msgspec.to_builtins(status)
    for key in IN_FRAMES:
        del state[key]
    state |= {f"counters.{key}": value for key, value in state.pop("counters").items()}
    state["unpaired"] = [finger.unpaired for finger in status.fingers]
    state["called_us"], state["until_us"] = inputs.called_us, inputs.until_us
    state["taken"], state["event_count"], state["waits"] = inputs.taken, inputs.event_count, inputs.waits
    return state


def _text(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


def read_ticks(path: Path, notes: Sequence[LogNote]) -> list[TickRecord]:
    """Return the recorded ticks of a log, none when it has no notes of a host.

    An incomplete last note is omitted. Raises LogError, with the time, for a note that is not a host's.
    """
    own = [note for note in notes if note.kind in (INPUT, TICK)]
    ticks: list[TickRecord] = []
    state: dict[str, Any] = {}
    events: list[HostInput] = []
    for number, note in enumerate(own, start=1):
        try:
            content = json.loads(note.text)
            if note.kind == INPUT:
                events.append(msgspec.convert(content, HostInput))
                continue
            state |= content
            ticks.append(_record(state, tuple(events)))
            events = []
        except (ValueError, TypeError, KeyError, msgspec.ValidationError):
            if number < len(own):
                raise LogError(
                    f"bus log {path}: the host's note at {note.stamp_us / 1e6:.6f} is damaged:"
                    " record the log again"
                ) from None
    return ticks


def _record(state: dict[str, Any], events: tuple[HostInput, ...]) -> TickRecord:
    fields = dict(state)
    numbers = {key: fields.pop(key) for key in ("called_us", "taken", "until_us", "event_count", "waits")}
    inputs = TickInputs(**numbers, events=events)
    unpaired, command_Nm = fields.pop("unpaired"), fields.pop("command_Nm", None)
    counters = {
        key.removeprefix("counters."): fields.pop(key) for key in state if key.startswith("counters.")
    }
    fields |= {"counters": counters, "fingers": (), "joints": (), "R_vir": None}
    status = msgspec.convert(fields, HostStatus)
    commands = None if command_Nm is None else tuple(float(value) for value in command_Nm)
    return TickRecord(status, inputs, tuple(unpaired), commands)


def counted_ids(accept_ids: Collection[int]) -> frozenset[int]:
    """Return the identifiers whose frames `TickInputs.taken` counts."""
    return frozenset(accept_ids) - {NMT_ID} - set(SDO_REQUEST_IDS)


def missing_ticks(ticks: Iterable[TickRecord]) -> list[tuple[int, int]]:
    """Return the gaps in the ticks: time of the tick after it (epoch us), and number of missing ticks."""
    gaps = []
    last: int | None = None
    for tick in ticks:
        number = tick.status.counters.ticks
        if last is not None and number != last + 1:
            gaps.append((tick.status.time_us, number - last - 1))
        last = number
    return gaps


def missing_events(ticks: Sequence[TickRecord]) -> list[tuple[int, int]]:
    """Return where the log lacks commands or other events: time of the tick after them, and their number.

    The number is negative where the log has more than the host counted.
    """
    gaps = []
    before = 0 if ticks and ticks[0].status.counters.ticks == 1 else None
    for tick in ticks:
        count = tick.inputs.event_count
        missing = 0 if before is None else count - before - len(tick.inputs.events)
        if missing:
            gaps.append((tick.status.time_us, missing))
        before = count
    return gaps
