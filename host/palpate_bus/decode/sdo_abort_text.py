"""Text of SDO abort codes."""

from __future__ import annotations

from canopen.sdo.exceptions import SdoAbortedError

from palpate_edge.common.contact_quantities import AI_AUTOZERO
from palpate_edge.node.change_policy import AT_REST, rule_of
from palpate_edge.node.sdo_abort import AbortCode
from palpate_edge.node.stored_parameters import RESTORE, STORE

_SAVE_STATE = "the node is OPERATIONAL, or it is saving: palpate-host bus nmt preop NODE, and write again"
_AT_REST = (
    "the node is OPERATIONAL, or the PDO is valid: palpate-host bus nmt preop NODE; for a PDO set bit 31 of "
    "its COB-ID; write again"
)
_TOO_OFTEN = "the node was asked too often: wait a minute, and write again"
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
    if code == AbortCode.LOCAL_CONTROL:
        return _TOO_OFTEN
    if code == AbortCode.DEVICE_STATE and index in _STATE_REMEDIES:
        return _STATE_REMEDIES[index]
    if code == AbortCode.DEVICE_STATE and rule_of(index).states == AT_REST:
        return _AT_REST
    return "give another object or value"
