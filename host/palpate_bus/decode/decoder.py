"""Decoder of CAN frames: CiA 301's services by their identifiers, values by the EDS files.

The only state of a decoder is that of the SDO transfers in progress, which take several frames.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum

from palpate_bus.decode.device import FINGERTIP_NODES, Device, Reading, usual_device
from palpate_bus.decode.emcy_text import emcy_text, register_text
from palpate_bus.decode.lss_text import lss_text
from palpate_bus.decode.sdo_decode import SdoListener
from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame

LSS_TO_MASTER, LSS_TO_SLAVE = 0x7E4, 0x7E5
TIME_ID, SYNC_ID = 0x100, 0x080
MS_A_DAY = 86_400_000

_NMT_COMMANDS = {
    1: "start",
    2: "stop",
    0x80: "enter pre-operational",
    0x81: "reset node",
    0x82: "reset communication",
}
_NMT_STATES = {0: "boot-up", 4: "stopped", 5: "operational", 0x7F: "pre-operational"}


class Service(Enum):
    """Communication objects of CiA 301."""

    NMT = "nmt"
    SYNC = "sync"
    TIME = "time"
    EMCY = "emcy"
    TPDO = "tpdo"
    RPDO = "rpdo"
    SDO = "sdo"
    HEARTBEAT = "heartbeat"
    LSS = "lss"
    OTHER = "other"


@dataclass(frozen=True, slots=True)
class Decoded:
    """One decoded frame. node_id: its node, None for a frame to all nodes. text: contents without values."""

    stamp_us: int
    frame: CanFrame
    service: Service
    node_id: int | None
    device: str
    text: str
    readings: tuple[Reading, ...] = ()


class Decoder:
    """Decoder of a stream of frames. devices: by node id; `usual` gives the device of any other id."""

    def __init__(
        self,
        devices: Mapping[int, Device] | None = None,
        usual: Callable[[int], Device | None] = usual_device,
    ) -> None:
        self._devices: dict[int, Device | None] = dict(devices or {})
        self._usual = usual
        self._sdo: dict[int, SdoListener] = {}
        self._broadcasts = _broadcasts(self._devices.values()) or _broadcasts([usual(FINGERTIP_NODES[0])])

    def device(self, node_id: int) -> Device | None:
        """Return the node's device, None when it is unknown."""
        if node_id not in self._devices:
            self._devices[node_id] = self._usual(node_id)
        return self._devices[node_id]

    def decode(self, record: LogRecord) -> Decoded:
        """Decode one frame. No content of a frame raises an exception."""
        frame = record.frame
        service, node_id = self._service(frame.can_id)
        device = None if node_id is None else self.device(node_id)
        if service is Service.RPDO and node_id is None:
            return Decoded(
                record.stamp_us, frame, service, None, "", *_pdo(self._broadcasts[frame.can_id], frame)
            )
        name = device.name if device else ("" if node_id is None else f"node 0x{node_id:02X}")
        readings: tuple[Reading, ...] = ()
        if frame.remote:
            text = "remote request"
        elif service in (Service.TPDO, Service.RPDO):
            text, readings = _pdo(device, frame)
        elif service is Service.SDO and node_id is not None:
            listener = self._sdo.setdefault(node_id, SdoListener(device))
            text, readings = listener.listen(frame.can_id >= 0x600, frame.data)
        elif service is Service.EMCY and len(frame.data) == 8:
            text = _emcy(frame.data, device.product if device else "")
        else:
            text = self._plain(service, frame.data)
        return Decoded(record.stamp_us, frame, service, node_id, name, text, readings)

    def _service(self, can_id: int) -> tuple[Service, int | None]:
        fixed = {0: Service.NMT, SYNC_ID: Service.SYNC, TIME_ID: Service.TIME}
        fixed |= {LSS_TO_MASTER: Service.LSS, LSS_TO_SLAVE: Service.LSS}
        if can_id in fixed:
            return fixed[can_id], None
        if can_id in self._broadcasts:
            return Service.RPDO, None
        node_id, function = can_id & 0x7F, can_id & 0x780
        is_pdo = node_id != 0 and 0x180 <= function <= 0x500
        owner = self.device(node_id) if is_pdo else None
        for device in (owner, *self._devices.values()):
            if device is not None and can_id in device.pdos:
                label = device.pdos[can_id].label
                return (Service.TPDO if label.startswith("T") else Service.RPDO), device.node_id
        if node_id == 0:
            return Service.OTHER, None
        if is_pdo:
            return (Service.TPDO if function & 0x080 else Service.RPDO), node_id
        services = {0x080: Service.EMCY, 0x580: Service.SDO, 0x600: Service.SDO, 0x700: Service.HEARTBEAT}
        found = services.get(function, Service.OTHER)
        return found, None if found is Service.OTHER else node_id

    def _plain(self, service: Service, data: bytes) -> str:
        try:
            return _PLAIN[service](self, data)
        except IndexError:
            return f"malformed: {len(data)} bytes"

    def _nmt(self, data: bytes) -> str:
        who = self.device(data[1]) if data[1] else None
        target = who.name if who else (f"node 0x{data[1]:02X}" if data[1] else "all nodes")
        return f"{_NMT_COMMANDS.get(data[0], f'unknown command {data[0]:02X}h')} {target}"


def _broadcasts(devices: Iterable[Device | None]) -> dict[int, Device]:
    """Return the RPDOs that several nodes receive, such as the host's time stamp, by identifier."""
    return {
        can_id: device
        for device in devices
        if device is not None
        for can_id, pdo in device.pdos.items()
        if pdo.label.startswith("R") and can_id & 0x7F != device.node_id
    }


def _pdo(device: Device | None, frame: CanFrame) -> tuple[str, tuple[Reading, ...]]:
    function = frame.can_id & 0x780
    label = f"{'TPDO' if function & 0x080 else 'RPDO'} {((function - 0x100) >> 8) or 1}"
    pdo = device.pdos.get(frame.can_id) if device else None
    if device is None or pdo is None:
        return f"{label} (no EDS): {frame.data.hex(' ')}", ()
    found = pdo.in_frame(frame)
    if found is None:
        return f"{pdo.label}: malformed: {len(frame.data)} bytes, its mapping has {(pdo.bits + 7) // 8}", ()
    return pdo.label, device.pdo_readings(found, frame.data)


def _heartbeat(data: bytes) -> str:
    state = data[0] & 0x7F
    return _NMT_STATES.get(state, f"unknown state {state:02X}h")


def _emcy(data: bytes, product: str) -> str:
    code = data[0] | data[1] << 8
    details = f", {data[3:].hex(' ')}" if any(data[3:]) else ""
    return f"{code:04X}h {emcy_text(code, product)}; error register {register_text(data[2])}{details}"


def _time(data: bytes) -> str:
    """Decode TIME_OF_DAY: ms after midnight (28 bits), days since 1984-01-01."""
    if len(data) != 6:
        return f"malformed: {len(data)} bytes, a time stamp has 6"
    ms = int.from_bytes(data[:4], "little") & 0x0FFF_FFFF
    days = int.from_bytes(data[4:], "little")
    if ms >= MS_A_DAY:
        return f"malformed: day {days}, {ms} ms, a day has {MS_A_DAY} ms"
    return f"day {days} since 1984-01-01, {ms // 3600000:02d}:{ms // 60000 % 60:02d}:{ms / 1000 % 60:06.3f}"


def _sync(data: bytes) -> str:
    return f"counter {data[0]}" if data else ""


_PLAIN: dict[Service, Callable[[Decoder, bytes], str]] = {
    Service.NMT: Decoder._nmt,
    Service.SYNC: lambda _, data: _sync(data),
    Service.TIME: lambda _, data: _time(data),
    Service.EMCY: lambda _, data: f"malformed: {len(data)} bytes, an emergency has 8",
    Service.HEARTBEAT: lambda _, data: _heartbeat(data),
    Service.LSS: lambda _, data: lss_text(data),
    Service.OTHER: lambda _, data: data.hex(" "),
}
