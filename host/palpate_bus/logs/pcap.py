"""Bus logs as pcap files for Wireshark: link type 227, LINKTYPE_CAN_SOCKETCAN.

``tshark -r bus.pcap -d can.subdissector,canopen`` decodes them. Source: pcap savefile format
(draft-ietf-opsawg-pcap, 4-5) and the link-type page of LINKTYPE_CAN_SOCKETCAN: identifier and flags U32 in
network byte order (bit 30: remote), length U8, flags of CAN FD U8 (CANFD_BRS, CANFD_FDF), two bytes zero,
data.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from struct import Struct

from palpate_bus.logs.candump import LogError, LogRecord
from palpate_edge.can_bus.link import CAN_FD_FLAGS
from palpate_edge.common.atomic_write import write_atomically

LINKTYPE_CAN_SOCKETCAN = 227
_REMOTE_FLAG = 0x4000_0000
_FILE_HEADER = Struct("<IHHiIII")  # magic (microseconds), version 2.4, zone, accuracy, snap length, link type
_RECORD_HEADER = Struct("<IIII")  # seconds, microseconds, captured length, length
_CAN_HEADER = Struct(">IBBxx")


def pcap_bytes(records: Iterable[LogRecord]) -> bytes:
    """Return the contents of a pcap file with the records, in their order, with exact microseconds."""
    parts = [_FILE_HEADER.pack(0xA1B2C3D4, 2, 4, 0, 0, 65535, LINKTYPE_CAN_SOCKETCAN)]
    for record in records:
        seconds, micros = divmod(record.stamp_us, 1_000_000)
        frame = record.frame
        identifier = frame.can_id | (_REMOTE_FLAG if frame.remote else 0)
        # A remote frame has a length but no data.
        packet = _CAN_HEADER.pack(identifier, len(frame.data), CAN_FD_FLAGS if frame.fd else 0)
        packet += b"" if frame.remote else frame.data
        parts += [_RECORD_HEADER.pack(seconds, micros, len(packet), len(packet)), packet]
    return b"".join(parts)


def write_pcap(path: Path, records: Iterable[LogRecord]) -> None:
    """Write the pcap file. Raises LogError when it cannot be written."""
    write_atomically(path, pcap_bytes(records), LogError)
