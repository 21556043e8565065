"""Text of SDO abort codes."""

from __future__ import annotations

from canopen.sdo.exceptions import SdoAbortedError

from palpate_edge.common.contact_quantities import AI_AUTOZERO
from palpate_edge.node.sdo_abort import AbortCode
from palpate_edge.node.stored_parameters import RESTORE, STORE

_SAVE_STATE = "the node is OPERATIONAL, or it is saving: palpate-host bus nmt preop NODE, and write again"
_STATE_REMEDIES = {
    AI_AUTOZERO: (
        "something touches the fingertip, or it has no tare: release it and write again; "
        "for a dent that remains when nothing touches, write ZERO"
    ),
    STORE: _SAVE_STATE,
    RESTORE: _SAVE_STATE,
}
"""Index -> remedy, where the state of the device forbids a write."""


def abort_text(code: int) -> str:
    """Return the text of CiA 301 for a code, from the list in the canopen package."""
    text: str = SdoAbortedError.CODES.get(code, "unknown abort code")
    return text


def abort_remedy(index: int, code: int) -> str:
    """Return the remedy for an aborted access to an object."""
    remedy = _STATE_REMEDIES.get(index) if code == AbortCode.DEVICE_STATE else None
    return remedy or "give another object or value"
