"""A run with real devices: serial ports, camera and clock around :class:`RigCore`."""

from __future__ import annotations

import select
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Protocol

from palpate_edge.common.errors import CaptureError, MissingExtraError, RigError, reason_of
from palpate_edge.common.frame import Frame
from palpate_edge.press_rig.rig_core import RigCore, RigOutputs

WAIT_S = 0.02  # for bytes, at most
MOST_BYTES = 65536
INTERRUPTED = "stopped: the ball was lifted off; repeat the command to go on"


class RunCamera(Protocol):
    """The part of a capture source that a run uses."""

    def read(self) -> Frame | None: ...


class SerialPort(Protocol):
    """The part of pyserial's Serial that a run uses."""

    def fileno(self) -> int: ...

    def read(self, size: int = ..., /) -> bytes: ...

    def write(self, data: bytes, /) -> int | None: ...

    def close(self) -> None: ...


@contextmanager
def open_port(path: str, baud: int, what: str) -> Iterator[SerialPort]:
    """Open a serial port for this process alone. Raises RigError with `what` the port is for."""
    try:
        import serial  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise MissingExtraError("palpate-edge press-rig", "serial", "press-rig") from error
    try:
        port = serial.Serial(path, baud, timeout=0, exclusive=True)
    except (serial.SerialException, OSError, ValueError) as error:
        reason = reason_of(error) if isinstance(error, OSError) and error.errno else str(error)
        raise RigError(
            f"{path} ({what}) cannot be opened: {reason}; correct {what}.port in rig.toml"
        ) from None
    with closing(port):
        port.reset_input_buffer()  # what came before is old
        yield port


def run_rig(
    core: RigCore,
    printer: SerialPort,
    scale: SerialPort,
    camera: RunCamera,
    clock_us: Callable[[], int],
    stopped: threading.Event,
    after_step: Callable[[RigOutputs], None],
) -> None:
    """Run to the end; `after_step` stores and prints what a step gave. `stopped` lifts the ball off first.

    Raises RigError, ConfigError or CaptureError once the ball is off the dome.
    """
    frame: Frame | None = None
    ports = [printer, scale]
    while True:
        if stopped.is_set():
            core.stop(INTERRUPTED)
        try:
            from_scale = scale.read(MOST_BYTES) if scale in ports else b""
        except OSError as error:
            from_scale = b""
            ports.remove(scale)
            core.stop(f"the scale was unplugged: {error}")
        outputs = core.process(clock_us(), _read(printer), from_scale, frame)
        if outputs.to_printer:
            _write(printer, outputs.to_printer)
        after_step(outputs)
        if outputs.is_done:
            return
        frame = None
        if outputs.wants_picture:
            frame = _picture(core, camera)
        elif not outputs.to_printer:
            select.select(ports, [], [], WAIT_S)


def _picture(core: RigCore, camera: RunCamera) -> Frame | None:
    """Return the camera's next frame; stop the run without one."""
    try:
        frame = camera.read()
    except CaptureError as error:
        core.stop(f"no picture: {error}")
        return None
    if frame is None:
        core.stop("no picture: the recording has ended; a run needs a camera")
    return frame


def _read(printer: SerialPort) -> bytes:
    try:
        return printer.read(MOST_BYTES)
    except OSError as error:  # pyserial's SerialException as well
        raise RigError(f"the printer was unplugged: {error}") from None


def _write(printer: SerialPort, data: bytes) -> None:
    try:
        printer.write(data)
    except OSError as error:
        raise RigError(f"the printer was unplugged: {error}") from None
