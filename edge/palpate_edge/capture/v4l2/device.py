"""An open video device: its ioctls, with errors that name the camera."""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from ctypes import Structure, c_int
from pathlib import Path

from palpate_edge.capture.v4l2.structures import (
    FRAME_SIZE_DISCRETE,
    BufferType,
    Capabilities,
    Capability,
    Control,
    FormatDescription,
    FrameSize,
    Ioctl,
    QueryControl,
)
from palpate_edge.common.errors import CameraLostError, CaptureError

UNPLUGGED = frozenset({errno.ENODEV, errno.ENXIO, errno.ENOENT})


class VideoDevice:
    """A camera that can stream.

    Methods raise CameraLostError when the camera is missing or was unplugged, CaptureError when it cannot be
    used.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.fd = os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise self._failure("cannot be opened", error) from error
        try:
            self.capabilities = Capabilities()
            self.call(Ioctl.QUERYCAP, self.capabilities)
            self._check_capabilities()
        except CaptureError:
            self.close()
            raise

    def call(self, request: Ioctl, argument: Structure | c_int) -> None:
        """Execute an ioctl that has to succeed."""
        try:
            self._ioctl(request, argument)
        except OSError as error:
            raise self._failure(f"refuses VIDIOC_{request.name}", error) from error

    def try_call(self, request: Ioctl, argument: Structure) -> bool:
        """Execute an ioctl that may be refused; return False for EINVAL, ENOTTY, EBUSY, EAGAIN, EIO and the
        like."""
        try:
            self._ioctl(request, argument)
        except OSError as error:
            if error.errno in UNPLUGGED:
                raise self._failure(f"refuses VIDIOC_{request.name}", error) from error
            return False
        return True

    def formats(self) -> list[int]:
        """Return the FourCC codes of the camera's formats."""
        codes = []
        description = FormatDescription(type=BufferType.VIDEO_CAPTURE)
        while self.try_call(Ioctl.ENUM_FMT, description):
            codes.append(description.pixelformat)
            description = FormatDescription(index=len(codes), type=BufferType.VIDEO_CAPTURE)
        return codes

    def sizes(self, fourcc: int) -> Iterator[tuple[int, int]]:
        """Yield the discrete sizes (width, height) of a format; none for a camera with ranges."""
        size = FrameSize(pixel_format=fourcc)
        while self.try_call(Ioctl.ENUM_FRAMESIZES, size) and size.type == FRAME_SIZE_DISCRETE:
            yield size.width, size.height
            size = FrameSize(index=size.index + 1, pixel_format=fourcc)

    def query_control(self, control_id: int) -> QueryControl | None:
        """Return the description of a control; None when the camera does not have it."""
        query = QueryControl(id=control_id)
        return query if self.try_call(Ioctl.QUERYCTRL, query) else None

    def get_control(self, control_id: int) -> int | None:
        """Return the value of a control; None when the camera does not have it."""
        control = Control(id=control_id)
        return control.value if self.try_call(Ioctl.G_CTRL, control) else None

    def set_control(self, control_id: int, value: int) -> bool:
        """Set a control; return whether the driver accepted the value."""
        return self.try_call(Ioctl.S_CTRL, Control(id=control_id, value=value))

    def close(self) -> None:
        """Close the device; a second call does nothing."""
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1

    def _ioctl(self, request: Ioctl, argument: Structure | c_int) -> None:
        while True:
            try:
                fcntl.ioctl(self.fd, request, argument)
            except InterruptedError:
                continue
            return

    def _check_capabilities(self) -> None:
        needed = Capability.VIDEO_CAPTURE | Capability.STREAMING
        if self.capabilities.device_caps & needed != needed:
            raise CaptureError(
                f"camera {self.path} is not a capture device that streams: choose the camera's node that "
                "ends with video-index0 (ls -l /dev/v4l/by-path)"
            )

    def _failure(self, what: str, error: OSError) -> CaptureError:
        reason = f"camera {self.path} {what} ({error.strerror})"
        if error.errno in UNPLUGGED:
            return CameraLostError(f"{reason}: check its cable; it is being searched for")
        if error.errno == errno.EBUSY:
            return CaptureError(f"{reason}: another program uses it (fuser -v {self.path})")
        if error.errno in {errno.EACCES, errno.EPERM}:
            return CaptureError(f"{reason}: add this user to the group video")
        return CaptureError(f"{reason}: see v4l2-ctl --all -d {self.path}")
