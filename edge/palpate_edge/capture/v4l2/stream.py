"""A running stream: the driver's buffers, mapped; reading returns the newest frame."""

from __future__ import annotations

import ctypes
import mmap
import select
from collections.abc import Callable
from contextlib import suppress

import msgspec

from palpate_edge.capture.v4l2.device import VideoDevice
from palpate_edge.capture.v4l2.structures import (
    Buffer,
    BufferFlag,
    BufferType,
    Ioctl,
    Memory,
    RequestBuffers,
)
from palpate_edge.common.errors import CameraLostError, CameraStalledError, CaptureError, reason_of

BUFFERS = 4  # one being filled, one being read, two spare for a late reader


class RawFrame(msgspec.Struct, frozen=True):
    """A filled buffer. data: valid until the buffer is returned; stamp_us: CLOCK_MONOTONIC, None when the
    driver uses another clock; damaged: the driver flagged lost data."""

    index: int
    data: memoryview
    sequence: int
    stamp_us: int | None
    damaged: bool


class BufferStream:
    """Maps buffers and starts streaming; `close` stops the stream and leaves the device open."""

    def __init__(self, device: VideoDevice) -> None:
        self._device = device
        self._maps: list[mmap.mmap] = []
        self._poll = select.poll()
        self._poll.register(device.fd, select.POLLIN)
        try:
            self._map_buffers()
            device.call(Ioctl.STREAMON, ctypes.c_int(BufferType.VIDEO_CAPTURE))
        except CaptureError:
            self._unmap()
            raise

    def read(self, timeout_s: float, use: Callable[[RawFrame], None]) -> None:
        """Wait for a frame and call `use` with the newest; older frames are skipped.

        Raises CameraStalledError when none comes in time, CameraLostError when the camera was unplugged.
        """
        self._wait(timeout_s)
        frame = self._take()
        while frame is not None and (newer := self._take()) is not None:
            self._give_back(frame)
            frame = newer
        if frame is None:
            return
        try:
            use(frame)
        finally:
            self._give_back(frame)

    def close(self) -> None:
        """Stop and release the buffers, also those of an unplugged camera."""
        with suppress(CaptureError):
            self._device.call(Ioctl.STREAMOFF, ctypes.c_int(BufferType.VIDEO_CAPTURE))
        self._unmap()

    def _wait(self, timeout_s: float) -> None:
        events = self._poll.poll(1000 * timeout_s)
        if not events:
            raise CameraStalledError(
                f"camera {self._device.path} gave no frame for {timeout_s:.2f} s: check its cable and power; "
                "it is being reopened"
            )
        if events[0][1] & (select.POLLERR | select.POLLHUP | select.POLLNVAL):
            raise CameraLostError(
                f"camera {self._device.path} was unplugged or stopped: check its cable; "
                "it is being searched for"
            )

    def _map_buffers(self) -> None:
        request = RequestBuffers(count=BUFFERS, type=BufferType.VIDEO_CAPTURE, memory=Memory.MMAP)
        self._device.call(Ioctl.REQBUFS, request)
        if request.count < 2:
            raise CaptureError(
                f"camera {self._device.path} has memory for {request.count} buffers, at least 2 are needed: "
                "use another camera or a smaller image"
            )
        for index in range(request.count):
            buffer = _buffer(index)
            self._device.call(Ioctl.QUERYBUF, buffer)
            try:
                self._maps.append(mmap.mmap(self._device.fd, buffer.length, offset=buffer.m.offset))
            except OSError as error:
                raise CaptureError(
                    f"camera {self._device.path}: its buffers cannot be mapped ({reason_of(error)}): "
                    "unplug it and plug it in again"
                ) from error
            self._device.call(Ioctl.QBUF, buffer)

    def _take(self) -> RawFrame | None:
        buffer = _buffer(0)
        if not self._device.try_call(Ioctl.DQBUF, buffer):
            return None
        monotonic = buffer.flags & BufferFlag.TIMESTAMP_MASK == BufferFlag.TIMESTAMP_MONOTONIC
        stamp = buffer.timestamp
        return RawFrame(
            buffer.index,
            memoryview(self._maps[buffer.index])[: buffer.bytesused],
            buffer.sequence,
            stamp.tv_sec * 1_000_000 + stamp.tv_usec if monotonic else None,
            bool(buffer.flags & BufferFlag.ERROR),
        )

    def _give_back(self, frame: RawFrame) -> None:
        frame.data.release()
        self._device.call(Ioctl.QBUF, _buffer(frame.index))

    def _unmap(self) -> None:
        for memory in self._maps:
            memory.close()
        self._maps.clear()


def _buffer(index: int) -> Buffer:
    return Buffer(index=index, type=BufferType.VIDEO_CAPTURE, memory=Memory.MMAP)
