"""The host's record of one finger: its last contact, the contact's age, and the frame rate."""

from __future__ import annotations

from collections import deque

from palpate_edge.common.contact_quantities import ATTRIBUTES
from palpate_host.common.status import FingerStatus
from palpate_host.common.tip_contact import TipContact
from palpate_host.network.boot_check import BootCheck
from palpate_host.network.fingertip_contract import fingertip_contract
from palpate_host.network.fingertips import Fingertip
from palpate_host.safety.supervisor import FingerHealth

RATE_WINDOW_US = 1_000_000
RATE_SAMPLES = 256


class FingerRecord:
    """One finger's fingertip with the ages for the supervisor and the figures for the status."""

    def __init__(
        self,
        name: str,
        node_id: int,
        *,
        poses: bool = True,
        serial: int | None = None,
        calibration: str | None = None,
        software: str | None = None,
        data_bitrate: int | None = None,
        verifies: bool = True,
    ) -> None:
        """poses: see :class:`Fingertip`. serial, calibration, software: what hand.toml expects.

        data_bitrate: that of a CAN FD bus. verifies: read the fingertip before its contacts are used.
        """
        self.node_id = node_id
        self.tip = Fingertip(node_id, name, poses=poses, fd=data_bitrate is not None)
        contract = fingertip_contract(
            node_id,
            poses=poses,
            serial=serial,
            calibration=calibration,
            software=software,
            data_bitrate=data_bitrate,
        )
        who = f"fingertip of {name} (node 0x{node_id:02X})"
        self.boot = BootCheck(node_id, who, contract if verifies else (), signs=True)
        self.unpaired = 0
        self.unverified = 0  # TPDOs that came before the node was verified
        self.is_calibrated = True
        self.name = name
        self._last: TipContact | None = None
        self._valid_at_us: int | None = None
        self._touched_at_us: int | None = None
        self._received_us: deque[int] = deque(maxlen=RATE_SAMPLES)

    def forget(self) -> None:
        """Drop all contacts, after a boot or a lost bus, and wait for the first frame."""
        self.tip.forget()
        self._last = self._valid_at_us = self._touched_at_us = None

    def note(self, contact: TipContact) -> None:
        """Take a coherent contact. Ages count from its exposure."""
        self._last = contact
        self._received_us.append(contact.received_at_us)
        if contact.valid:
            self._valid_at_us = contact.exposed_at_us
        if contact.in_contact:
            self._touched_at_us = contact.exposed_at_us

    def health(self, now_us: int, heartbeat_timed_out: bool, *, is_lifted: bool = False) -> FingerHealth:
        """Return the finger's state for the supervisor. is_lifted: by a gait."""
        last = self._last
        return FingerHealth(
            name=self.name,
            gives_no_place=last is not None and last.position_mm is None,
            gives_no_force=last is not None and last.normal_force_N is None,
            frame_age_us=_age(now_us, self._valid_at_us),
            contact_age_us=_age(now_us, self._touched_at_us),
            in_contact=self._last is not None and self._last.in_contact,
            heartbeat_timed_out=heartbeat_timed_out,
            is_lifted=is_lifted,
            unverified="" if self.boot.is_verified else self.boot.problem or f"reading {self.boot.name}",
        )

    def status(self, now_us: int) -> FingerStatus:
        """Return the finger's part of the host's status."""
        while self._received_us and now_us - self._received_us[0] > RATE_WINDOW_US:
            self._received_us.popleft()
        last, counters = self._last, self.tip.counters
        age_us = None if last is None else _age(now_us, last.exposed_at_us)
        return FingerStatus(
            name=self.name,
            **{field: getattr(last, field) if last and last.in_contact else None for field in ATTRIBUTES},
            valid=last is not None and last.valid,
            in_contact=last is not None and last.in_contact,
            slip=last is not None and last.slip,
            quality=0 if last is None else last.quality,
            sequence=None if last is None else last.sequence,
            age_ms=None if age_us is None else age_us / 1000.0,
            latency_us=None if last is None else last.latency_us,
            frames_per_s=float(len(self._received_us)),
            complete=counters.complete,
            incomplete=counters.incomplete,
            out_of_order=counters.out_of_order,
            duplicates=counters.duplicates,
            late=counters.late,
            lost_frames=counters.lost_frames,
            unpaired=self.unpaired,
            extra_tpdos=counters.extra_tpdos,
            extra_missing=counters.extra_missing,
            extra_mixed=counters.extra_mixed,
            resynchronised=counters.resynchronised,
            unverified=self.unverified,
        )


def _age(now_us: int, then_us: int | None) -> int | None:
    return None if then_us is None else max(0, now_us - then_us)
