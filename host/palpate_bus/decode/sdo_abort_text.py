"""SDO abort codes in words."""

from __future__ import annotations

from canopen.sdo.exceptions import SdoAbortedError


def abort_text(code: int) -> str:
    """The text that CiA 301 gives a code, as the canopen package lists it."""
    text: str = SdoAbortedError.CODES.get(code, "unknown abort code")
    return text
