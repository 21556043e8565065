"""Contacts of a bus log against what really touched.

A fingertip that plays a recording plays it in a loop, so frame `sequence` is row `sequence` modulo the
recording's length of its truth.csv. The twin writes the truth of each frame that it renders.
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
from palpate_twin.demo.distribution import Distribution, distribution


@dataclass(frozen=True, slots=True)
class Touch:
    """What was true of one frame. position_mm: on the dome, in F; None when nothing touched."""

    position_mm: Vector3 | None
    normal_force_N: float


TruthOf = Callable[[int], Touch | None]
"""By the frame's sequence number; None for a frame that the truth does not know."""


def of_recording(presses: Sequence[Press]) -> TruthOf:
    """The truth of a recording that is played in a loop."""
    touches = [Touch(press.position_mm, press.normal_force_N) for press in presses]
    return lambda sequence: touches[sequence % len(touches)]


def of_twin(path: Path) -> TruthOf:
    """The truth that the twin's cameras wrote. Raises DatasetError when it is missing or damaged."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()[1:]
        rows = [line.split(",") for line in lines]
        touches = {int(row[0]): _touch(row[2:]) for row in rows if len(row) == TWIN_COLUMNS}
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path} cannot be read ({error}): run the demo again") from None
    return touches.get


TWIN_COLUMNS = 8  # palpate_twin.camera.live.COLUMNS


def _touch(cells: Sequence[str]) -> Touch:
    """From x, y, z in mm, empty without contact, and the force on the dome in N."""
    force_N = np.array([float(cell) for cell in cells[3:]])
    if not cells[0]:
        return Touch(None, 0.0)
    x, y, z = (float(cell) for cell in cells[:3])
    outward = np.array([x, y, z]) / math.hypot(x, y, z)
    return Touch((x, y, z), max(0.0, float(-force_N @ outward)))


@dataclass(frozen=True, slots=True)
class Pair:
    """One published frame and what was true when it was exposed. sequence: without the wrap of 16 bits."""

    sequence: int
    contact: TipContact
    truth: Touch

    @property
    def latency_us(self) -> int:
        """From exposure to TPDO 3 winning the bus, which ends the contact's transmission but for its bits."""
        return self.contact.received_at_us - self.contact.exposed_at_us

    @property
    def position_error_mm(self) -> float | None:
        """None unless both the bus and the truth say contact."""
        if not self.contact.in_contact or self.truth.position_mm is None:
            return None
        return math.dist(self.contact.position_mm, self.truth.position_mm)

    @property
    def force_error_N(self) -> float:
        """Published normal force, 0 without contact, less the true one."""
        published_N = self.contact.normal_force_N if self.contact.in_contact else 0.0
        return published_N - self.truth.normal_force_N


@dataclass(frozen=True, slots=True)
class FingerFigures:
    """One fingertip's figures.

    frames: contacts on the bus; dropped: gaps in their sequence; refused: not valid, left out of all errors;
    incomplete: frames of which a TPDO is missing, doubled or late. contact_right_percent: valid frames whose
    contact flag is the truth's. position_error_mm: where both say contact. force_rmse_N: over valid frames;
    force_rmse_percent: of the largest true force.
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
    """Every coherent contact of a node whose truth is known, and how many frames were not coherent.

    Raises BusError for a TPDO that is not the EDS's.
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
        Pair(sequence, contact, touch)
        for sequence, contact in zip(sequences, contacts, strict=True)
        if (touch := truth(sequence)) is not None
    ]
    return pairs, counters.incomplete + counters.out_of_order + counters.duplicates + counters.late


def unwrapped(sequences: Sequence[int]) -> list[int]:
    """Sequence numbers of 16 bits, counted on beyond the wrap; the first is taken as it is."""
    result = list(sequences[:1])
    for before, after in pairwise(sequences):
        result.append(result[-1] + (after - before) % SEQUENCE_WRAP)
    return result


def finger_figures(name: str, pairs: Sequence[Pair], incomplete: int) -> FingerFigures:
    """The figures of one finger; see `FingerFigures`."""
    valid = [pair for pair in pairs if pair.contact.valid]
    right = sum(pair.contact.in_contact == (pair.truth.position_mm is not None) for pair in valid)
    errors_mm = [error for pair in valid if (error := pair.position_error_mm) is not None]
    rmse_N = math.sqrt(sum(pair.force_error_N**2 for pair in valid) / len(valid)) if valid else None
    largest_N = max((pair.truth.normal_force_N for pair in valid), default=0.0)
    return FingerFigures(
        name=name,
        frames=len(pairs),
        dropped=sum(after.sequence - before.sequence - 1 for before, after in pairwise(pairs)),
        refused=len(pairs) - len(valid),
        incomplete=incomplete,
        contact_right_percent=100.0 * right / len(valid) if valid else None,
        position_error_mm=distribution(errors_mm),
        force_rmse_N=rmse_N,
        force_rmse_percent=100.0 * rmse_N / largest_N if rmse_N is not None and largest_N else None,
        latency_us=distribution([pair.latency_us for pair in pairs]),
    )
