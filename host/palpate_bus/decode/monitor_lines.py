"""Output of `palpate-host bus monitor`: selection of frames, and their lines."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from palpate_bus.decode.decoder import Decoded, Service


@dataclass(frozen=True, slots=True)
class Selection:
    """Selection of frames; an empty set selects all. Frames to all nodes (NMT, SYNC) have no node."""

    nodes: frozenset[int] = frozenset()
    services: frozenset[Service] = frozenset()

    def shows(self, decoded: Decoded) -> bool:
        """Return whether a frame is selected."""
        return (not self.nodes or decoded.node_id in self.nodes) and (
            not self.services or decoded.service in self.services
        )


def line(decoded: Decoded, begin_us: int) -> str:
    """Return one frame as text: seconds since the first frame, identifier, service, device, contents."""
    frame = decoded.frame
    what = decoded.text
    if decoded.service in (Service.TPDO, Service.RPDO) and decoded.readings:
        values = ", ".join(f"{reading.name} {reading.text}" for reading in decoded.readings)
        what = f"{what}: {values}"
    return (
        f"{(decoded.stamp_us - begin_us) / 1e6:>12.6f}  {frame.can_id:03X}  {decoded.service.value:<9}  "
        f"{decoded.device:<14}  {what}"
    ).rstrip()


def json_line(decoded: Decoded) -> str:
    """Return one frame as JSON: time_us, can_id, data, remote, service, node, device, text, values."""
    frame = decoded.frame
    return msgspec.json.encode(
        {
            "time_us": decoded.stamp_us,
            "can_id": f"{frame.can_id:03X}",
            "data": frame.data.hex(),
            "remote": frame.remote,
            "service": decoded.service.value,
            "node": decoded.node_id,
            "device": decoded.device,
            "text": decoded.text,
            "values": [
                {"name": r.name, "value": r.value, "unit": r.unit, "raw": r.raw} for r in decoded.readings
            ],
        }
    ).decode()
