"""Emergencies of a fingertip in addition to those of the node core: codes, names, active ones."""

from __future__ import annotations

from enum import IntEnum

from palpate_edge.node.emcy import EmergencyProducer, ErrorRegister


class Emergency(IntEnum):
    """Error codes: CiA 301, 7.2.7.1, and its device-specific range FFxxh."""

    LED_TOO_HOT = 0x4200
    RECEIVE_OVERRUN = 0x8110
    ERROR_PASSIVE = 0x8120
    BUS_OFF_RECOVERED = 0x8140
    ID_COLLISION = 0x8150
    CAMERA_LOST = 0xFF01
    CAMERA_STALLED = 0xFF02
    BEADS_LOST = 0xFF03
    OVERRUN = 0xFF04
    CLOCK_LOST = 0xFF05
    LIGHT_LOST = 0xFF06
    NO_CALIBRATION = 0xFF07


REGISTER = {
    Emergency.LED_TOO_HOT: ErrorRegister.TEMPERATURE,
    Emergency.RECEIVE_OVERRUN: ErrorRegister.COMMUNICATION,
    Emergency.ERROR_PASSIVE: ErrorRegister.COMMUNICATION,
    Emergency.ID_COLLISION: ErrorRegister.COMMUNICATION,
    Emergency.CLOCK_LOST: ErrorRegister.COMMUNICATION,
}
"""Register bits of the emergencies; the others set the manufacturer bit.

8140h is reported by `Slave.communication_error`, which also applies 1029h.
"""


def name_of(emergency: Emergency) -> str:
    """Return the name used in health reports and logs: ``camera lost`` and so on."""
    return emergency.name.lower().replace("_", " ")


class ActiveEmergencies:
    """Active emergencies; each is reported when set and when cleared, and survives an NMT reset."""

    def __init__(self, producer: EmergencyProducer) -> None:
        self._producer = producer
        self._active: dict[Emergency, bytes] = {}

    def set(self, emergency: Emergency, active: bool, info: bytes = b"") -> None:
        """Report or clear an emergency if its state changed. info: manufacturer-specific bytes, five at
        most."""
        if active and emergency not in self._active:
            self._active[emergency] = info
            self._report(emergency)
        elif not active and emergency in self._active:
            self._producer.clear(emergency, self._active.pop(emergency))

    def names(self) -> list[str]:
        """Return the names of the active emergencies, the oldest first."""
        return [name_of(emergency) for emergency in self._active]

    def after_reset(self) -> None:
        """Report the active emergencies again after an NMT reset, which cleared them in the node."""
        for emergency in self._active:
            self._report(emergency)

    def _report(self, emergency: Emergency) -> None:
        register = REGISTER.get(emergency, ErrorRegister.MANUFACTURER)
        self._producer.report(emergency, register, self._active[emergency])
