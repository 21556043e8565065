"""Kinds of values in hand.toml, with the limits that msgspec checks."""

from __future__ import annotations

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
NodeId = Annotated[int, msgspec.Meta(ge=1, le=127)]
Text = Annotated[str, msgspec.Meta(min_length=1)]
Name = Annotated[str, msgspec.Meta(pattern=r"^\S+$", description="one word in quotes, without spaces")]
"""Names stand in log headers and option lists."""
CalibrationHash = Annotated[
    str, msgspec.Meta(pattern="^[0-9a-f]{16}$", description="16 digits 0-9, a-f in quotes, as in 2001h")
]
Milliseconds = Annotated[int, msgspec.Meta(ge=1, le=600_000)]
