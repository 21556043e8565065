"""The errors a person may meet: each says what, where, and the way out, in one line.

The command lines print ``error: <message>`` and leave with :data:`EXIT_STATUS` of the class; nothing else
in the packages catches them to go on silently.
"""

from __future__ import annotations


class PalpateError(Exception):
    """Base of every refusal; its text is one line that names the thing and the way out."""

    exit_status = 1


class ConfigError(PalpateError):
    """A configuration, description or option file is missing, garbled or out of range."""

    exit_status = 2


class DatasetError(PalpateError):
    """A press dataset, recording or single image cannot be used."""

    exit_status = 3


class CalibrationError(PalpateError):
    """A calibration is missing, damaged, or belongs to another sensor; or one cannot be made."""

    exit_status = 4


class CaptureError(PalpateError):
    """A capture source cannot be opened or has stopped giving frames."""

    exit_status = 5


class CameraLostError(CaptureError):
    """The camera is not there or was unplugged; it may come back."""


class CameraStalledError(CaptureError):
    """The camera is there and gives no frames; opening it again may help."""


class BusError(PalpateError):
    """The CAN bus, or what was received from it, cannot be used."""

    exit_status = 6


class BusOffError(BusError):
    """The controller took itself off the bus after too many errors; it may come back."""


class IlluminationError(PalpateError):
    """The illumination controller does not answer, is another, or refuses."""

    exit_status = 7
