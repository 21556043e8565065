"""Compare the contacts of a bus log with the true contacts.

A fingertip plays a recording in a loop, so frame `sequence` belongs to row (`sequence` modulo length) of the
recording's truth.csv. The twin writes the true contact of each frame that it renders.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from palpate_bus.logs.candump import LogRecord
from palpate_edge.common.contact import Vector3
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.press_dataset import Press
from palpate_edge.node.nmt import NmtState
from palpate_host.common.tip_contact import TipContact
from palpate_host.network.fingertips import SEQUENCE_WRAP, Fingertip
from palpate_host.network.nmt_master import HEARTBEAT_ID
from palpate_twin.camera.frame_truth import COLUMNS
from palpate_twin.demo.distribution import Distribution, distribution


@dataclass(frozen=True, slots=True)
class TrueContact:
    """True contact of one frame. position_mm: on the dome in frame F, None without contact."""

    position_mm: Vector3 | None
    normal_force_N: float


TruthOf = Callable[[int], TrueContact | None]
"""Maps a sequence number to the true contact; None if the truth has no such frame."""


def truth_of_recording(presses: Sequence[Press]) -> TruthOf:
    """Return the truth of a recording that is played in a loop."""
    contacts = [TrueContact(press.position_mm, press.normal_force_N or 0.0) for press in presses]
    return lambda sequence: contacts[sequence % len(contacts)]


def truth_of_twin(path: Path) -> TruthOf:
    """Read the truth written by the twin's cameras. Raises DatasetError if it is missing or damaged."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()[1:]
        rows = [line.split(",") for line in lines]
        contacts = {int(row[0]): _true_contact(row[2:]) for row in rows if len(row) == len(COLUMNS)}
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path} cannot be read ({error}): run the demo again") from None
    return contacts.get


def _true_contact(cells: Sequence[str]) -> TrueContact:
    """Parse x, y, z in mm (empty without contact) and the force on the dome in N."""
    force_N = np.array([float(cell) for cell in cells[3:]])
    if not cells[0]:
        return TrueContact(None, 0.0)
    x, y, z = (float(cell) for cell in cells[:3])
    outward = np.array([x, y, z]) / math.hypot(x, y, z)
    return TrueContact((x, y, z), max(0.0, float(-force_N @ outward)))


@dataclass(frozen=True, slots=True)
class Pair:
    """One published contact and the true one at its exposure. sequence: without the 16-bit wrap-around."""

    sequence: int
    contact: TipContact
    truth: TrueContact

    @property
    def latency_us(self) -> int:
        """Time from exposure to the arbitration of TPDO 3, the contact's last CAN frame."""
        return self.contact.received_at_us - self.contact.exposed_at_us

    @property
    def position_error_mm(self) -> float | None:
        """Distance between published and true position; None unless both have a contact."""
        published_mm = self.contact.position_mm if self.contact.in_contact else None
        if published_mm is None or self.truth.position_mm is None:
            return None
        return math.dist(published_mm, self.truth.position_mm)

    @property
    def force_error_N(self) -> float:
        """Published normal force (0 without contact, NaN where not known) minus the true one."""
        published_N = self.contact.normal_force_N if self.contact.in_contact else 0.0
        return math.nan if published_N is None else published_N - self.truth.normal_force_N


@dataclass(frozen=True, slots=True)
class FingerFigures:
    """Figures of one fingertip.

    frames: contacts on the bus. dropped: gaps in their sequence numbers. refused: rejected frames, excluded
    from all errors. incomplete: frames with a missing, duplicate or late TPDO. contact_right_percent: share
    of valid frames with the correct contact flag. position_error_mm: over frames in which both bus and truth
    have a contact. force_rmse_N: over valid frames; force_rmse_percent: relative to the largest true force.
    """

    name: str
    frames: int
    dropped: int
    refused: int
    incomplete: int
    contact_right_percent: float | None
    position_error_mm: Distribution | None
    force_rmse_N: float | None
    force_rmse_percent: float | None
    latency_us: Distribution | None


def read_pairs(records: Iterable[LogRecord], node_id: int, truth: TruthOf) -> tuple[list[Pair], int]:
    """Return every complete contact of a node whose truth is known, and the number of incomplete frames.

    Raises BusError for a TPDO that does not match the EDS.
    """
    tip = Fingertip(node_id, f"node 0x{node_id:02X}")
    boot_up_id, boot_up = HEARTBEAT_ID + node_id, bytes([NmtState.INITIALISING])
    contacts = []
    for record in records:
        if record.frame.can_id in tip.receive_ids:
            contact = tip.receive(record.stamp_us, record.frame)
            if contact is not None:
                contacts.append(contact)
        elif record.frame.can_id == boot_up_id and record.frame.data == boot_up:
            tip.forget()
    sequences = unwrapped([contact.sequence for contact in contacts])
    counters = tip.counters
    pairs = [
        Pair(sequence, contact, true_contact)
        for sequence, contact in zip(sequences, contacts, strict=True)
        if (true_contact := truth(sequence)) is not None
    ]
    torn = counters.incomplete + counters.out_of_order + counters.extra_missing + counters.extra_mixed
    return pairs, torn + counters.duplicates + counters.late


def unwrapped(sequences: Sequence[int]) -> list[int]:
    """Return 16-bit sequence numbers without their wrap-around; the first one stays as it is."""
    result = list(sequences[:1])
    for before, after in pairwise(sequences):
        result.append(result[-1] + (after - before) % SEQUENCE_WRAP)
    return result


def finger_figures(name: str, pairs: Sequence[Pair], incomplete: int) -> FingerFigures:
    """Return the figures of one finger."""
    valid = [pair for pair in pairs if pair.contact.valid]
    correct = sum(pair.contact.in_contact == (pair.truth.position_mm is not None) for pair in valid)
    errors_mm = [error for pair in valid if (error := pair.position_error_mm) is not None]
    rmse_N = math.sqrt(sum(pair.force_error_N**2 for pair in valid) / len(valid)) if valid else None
    largest_N = max((pair.truth.normal_force_N for pair in valid), default=0.0)
    return FingerFigures(
        name=name,
        frames=len(pairs),
        dropped=sum(after.sequence - before.sequence - 1 for before, after in pairwise(pairs)),
        refused=len(pairs) - len(valid),
        incomplete=incomplete,
        contact_right_percent=100.0 * correct / len(valid) if valid else None,
        position_error_mm=distribution(errors_mm),
        force_rmse_N=rmse_N,
        force_rmse_percent=100.0 * rmse_N / largest_N if rmse_N is not None and largest_N else None,
        latency_us=distribution([pair.latency_us for pair in pairs]),
    )
