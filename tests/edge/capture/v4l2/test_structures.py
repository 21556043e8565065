"""Layouts and ioctl numbers against linuxpy's, which are generated from the kernel's headers."""

from __future__ import annotations

import ctypes

import pytest
from linuxpy.video import raw

from palpate_edge.capture.v4l2 import structures as ours

PAIRS = [
    (ours.Capabilities, raw.v4l2_capability, {}),
    (ours.FormatDescription, raw.v4l2_fmtdesc, {}),
    (ours.FrameSize, raw.v4l2_frmsizeenum, {"width": None, "height": None, "stepwise_rest": None}),
    (ours.PixelFormat, raw.v4l2_pix_format, {"ycbcr_enc": None}),
    (ours.Format, raw.v4l2_format, {}),
    (ours.Fraction, raw.v4l2_fract, {}),
    (ours.CaptureParm, raw.v4l2_captureparm, {}),
    (ours.StreamParm, raw.v4l2_streamparm, {}),
    (ours.RequestBuffers, raw.v4l2_requestbuffers, {}),
    (ours.Timecode, raw.v4l2_timecode, {}),
    (ours.Buffer, raw.v4l2_buffer, {"request_fd": None}),
    (ours.QueryControl, raw.v4l2_queryctrl, {}),
    (ours.Control, raw.v4l2_control, {}),
]


@pytest.mark.parametrize(("mine", "theirs", "renamed"), PAIRS, ids=lambda one: getattr(one, "__name__", ""))
def test_every_field_lies_where_the_kernel_has_it(mine, theirs, renamed):
    assert ctypes.sizeof(mine) == ctypes.sizeof(theirs)
    for name, *_ in mine._fields_:
        if name not in renamed:
            at = getattr(mine, name)
            assert (at.offset, at.size) == (getattr(theirs, name).offset, getattr(theirs, name).size), name


def test_what_linuxpy_names_otherwise_lies_where_the_kernel_has_it():
    assert (ours.PixelFormat.ycbcr_enc.offset, ours.PixelFormat.ycbcr_enc.size) == (36, 4)
    assert (ours.Buffer.m.offset, ours.Buffer.request_fd.offset) == (64, 80)  # videodev2.h, 64-bit
    assert (ours.FrameSize.width.offset, ours.FrameSize.height.offset) == (12, 16)
    assert ours.Buffer.timestamp.offset == raw.v4l2_buffer.timestamp.offset


@pytest.mark.parametrize("request_", list(ours.Ioctl), ids=lambda one: one.name)
def test_every_ioctl_number_is_the_kernels(request_):
    theirs = raw.IOC[request_.name].value
    assert int(request_) == theirs & 0xFFFF_FFFF


def test_the_constants_are_the_kernels():
    assert ours.BufferType.VIDEO_CAPTURE == raw.BufType.VIDEO_CAPTURE
    assert ours.Memory.MMAP == raw.Memory.MMAP
    assert ours.Capability.VIDEO_CAPTURE == raw.Capability.VIDEO_CAPTURE
    assert ours.Capability.STREAMING == raw.Capability.STREAMING
    assert ours.BufferFlag.ERROR == raw.BufferFlag.ERROR
    assert ours.BufferFlag.TIMESTAMP_MONOTONIC == raw.BufferFlag.TIMESTAMP_MONOTONIC
    assert ours.BufferFlag.TIMESTAMP_MASK == raw.BufferFlag.TIMESTAMP_MASK
    assert ours.ControlFlag.DISABLED == raw.ControlFlag.DISABLED
    assert ours.ControlFlag.READ_ONLY == raw.ControlFlag.READ_ONLY
    assert ours.FIELD_NONE == raw.Field.NONE
    assert ours.FRAME_SIZE_DISCRETE == raw.Frmsizetypes.DISCRETE
