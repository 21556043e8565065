"""User-facing exceptions; each message states what failed, where, and how to fix it, in one line.

The command lines print ``error: <message>`` and exit with the class's `exit_status`; nothing else in the
packages catches these errors to continue silently.
"""

from __future__ import annotations

import errno

_REASONS = {
    errno.ENOENT: "no such file",
    errno.EISDIR: "is a folder",
    errno.ENOTDIR: "a part of its path is a file",
    errno.EACCES: "permission denied",
    errno.ENOSPC: "no space left on the disk",
    errno.EROFS: "the disk is read-only",
}

DISK_ERRORS = {errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG}
"""A disk that is full, read-only or failing: nothing that the program could have checked before."""


def reason_of(error: OSError) -> str:
    """Return why the operating system refused, in lower case, without its error number."""
    if error.errno in _REASONS:
        return _REASONS[error.errno]
    text = error.strerror or str(error) or type(error).__name__
    return text[:1].lower() + text[1:]


class PalpateError(Exception):
    """Base of every refusal; its text is one line."""

    exit_status = 1


class ConfigError(PalpateError):
    """A configuration, description or option file is missing, garbled or out of range."""

    exit_status = 2


class KernelsError(ConfigError):
    """The compiled kernels are missing for this machine, or are those of other sources."""


EXTRA_OF_LIBRARY = {
    "foxglove": "record",
    "matplotlib": "host",
    "mujoco": "host",
    "onnx": "train",
    "onnxruntime": "onnx",
    "pyarrow": "record",
    "pymodbus": "host",
    "rerun": "view",
    "rich": "host",
    "scipy": "twin",
    "serial": "host",
}
"""Import name of a library that only an extra of palpate installs -> the smallest extra that installs it."""


class MissingExtraError(ConfigError):
    """A library of an extra of palpate is not installed."""

    def __init__(self, what: str, library: str, extra: str = "") -> None:
        """what: the command or part that needs the library; extra: to install, by default the library's."""
        name = extra or EXTRA_OF_LIBRARY[library]
        super().__init__(f"{what} needs {library}: pip install 'palpate[{name}]'")
        self.library = library


def missing_library(error: ImportError) -> str | None:
    """Return the library of an extra whose absence caused `error`; None when the cause is another."""
    library = (error.name or "").partition(".")[0]
    return library if isinstance(error, ModuleNotFoundError) and library in EXTRA_OF_LIBRARY else None


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
    """The camera is absent or was unplugged; it may be plugged in again."""


class CameraStalledError(CaptureError):
    """The camera is present but gives no frames; opening it again may help."""


class BusError(PalpateError):
    """The CAN bus, or what was received from it, cannot be used."""

    exit_status = 6


class BusOffError(BusError):
    """The CAN controller went bus-off after too many errors; it may restart."""


class RigError(PalpateError):
    """The press rig stopped: printer, scale or probe do not answer, or a limit was reached."""

    exit_status = 8


class IlluminationError(PalpateError):
    """The illumination controller does not answer, is of another kind, or refuses."""

    exit_status = 7
