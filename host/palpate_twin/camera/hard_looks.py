"""Looks that are hard for the estimator, by name, and properties of a look as a command line gives them."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from palpate_edge.common.errors import ConfigError
from palpate_edge.common.struct_fault import struct_fault
from palpate_twin.camera.look import Look

COLOURS = {  # B, G, R
    "black": (38.0, 36.0, 38.0),
    "white": (205.0, 208.0, 210.0),
    "grey": (176.0, 176.0, 190.0),
    "skin": (135.0, 155.0, 200.0),
    "red": (45.0, 40.0, 200.0),
    "green": (50.0, 150.0, 45.0),
    "blue": (190.0, 80.0, 35.0),
    "cyan": (215.0, 200.0, 60.0),
    "yellow": (40.0, 190.0, 210.0),
}
HARD_LOOKS: dict[str, dict[str, object]] = {
    "veil": {
        "veil": 0.6,
        "dust": 40,
        "dust_contrast": 0.5,
        "changing_light": 0.3,
        "flicker": 0.08,
        "noise_grey": 3.0,
        "jpeg_quality": 60,
    },
    "overexposed": {"exposure": 1.7, "changing_light": 0.5, "flicker": 0.15, "noise_grey": 3.0},
    "room-light": {"changing_light": 1.5, "flicker": 0.1, "noise_grey": 3.0, "jpeg_quality": 60},
}


def with_properties(look: Look, properties: Sequence[str]) -> Look:
    """Return a look with some properties replaced, the later ones last.

    properties: names of :data:`HARD_LOOKS`, or KEY=VALUE with a field of Look; colours are names of
    :data:`COLOURS` or three numbers. Raises ConfigError for an unknown name and an unusable value.
    """
    fields = msgspec.json.decode(msgspec.json.encode(look))
    for text in properties:
        name, equals, value = text.partition("=")
        if not equals and name in HARD_LOOKS:
            fields |= HARD_LOOKS[name]
        elif equals and name in fields:
            fields[name] = _value(value)
        else:
            raise ConfigError(
                f"--look {text}: no such look: give {', '.join(HARD_LOOKS)}, or KEY=VALUE with one of "
                f"{', '.join(fields)}"
            )
    try:
        return msgspec.convert(fields, Look)
    except msgspec.ValidationError:
        raise ConfigError(f"--look: {struct_fault(fields, Look)}") from None


def _value(text: str) -> object:
    """Return a colour by its name, numbers by their text, or the text itself."""
    if text in COLOURS:
        return list(COLOURS[text])
    numbers = [_number(part) for part in text.split(",")]
    return numbers[0] if len(numbers) == 1 else numbers


def _number(text: str) -> object:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text
