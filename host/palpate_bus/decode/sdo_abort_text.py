"""Text of SDO abort codes."""

from __future__ import annotations

from canopen.sdo.exceptions import SdoAbortedError


def abort_text(code: int) -> str:
    """Return the text of CiA 301 for a code, from the list in the canopen package."""
    text: str = SdoAbortedError.CODES.get(code, "unknown abort code")
    return text
