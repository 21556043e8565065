"""Restricted identifiers and flags of COB-IDs (CiA 301)."""

from __future__ import annotations

from palpate_edge.node.sdo_abort import AbortCode, SdoAbortError

CAN_ID_MASK = 0x7FF
NOT_VALID = 1 << 31

RESTRICTED_IDS = (
    range(0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x800),
)
"""CiA 301, 7.3.5: identifiers of NMT, SDO, LSS and error control, and reserved ones."""


def check_cob_id(value: int, flags: int) -> None:
    """Raise SdoAbortError for a restricted identifier, or for a flag bit that is not in `flags`."""
    can_id = value & CAN_ID_MASK
    if value & ~(CAN_ID_MASK | flags) or any(can_id in ids for ids in RESTRICTED_IDS):
        raise SdoAbortError(AbortCode.VALUE_INVALID)
