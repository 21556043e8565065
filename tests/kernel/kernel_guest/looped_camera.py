"""A camera that shows given pictures: vivid's HDMI input, looped to its HDMI output.

The kernel copies what is written to the output into the frames of the camera ("Video and Sliced VBI
looping" in the kernel's documentation of vivid). Both ends have to agree in timings and pixel format.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2

from kernel_guest.cameras import v4l2_ctl, vivid
from palpate_edge.capture.v4l2.naming import BY_PATH
from palpate_edge.common.arrays import Image

OUTPUT = BY_PATH / "platform-vivid.0-video-index1"
HDMI_TO_HDMI = {"node_types": 0x101, "input_types": 3, "num_outputs": 1, "output_types": 1}
FPS = 40  # vivid's pixel clock of at least 14 MHz allows no less at 640x480


@contextmanager
def looped_camera(width: int, height: int) -> Iterator[tuple[Path, Callable[[Image], None]]]:
    """Yield the camera's stable name, and a function that shows it a BGR picture until the next one."""
    size = f"width={width},height={height}"
    with vivid(**HDMI_TO_HDMI) as name:
        for end in (name, OUTPUT):
            v4l2_ctl(end, f"--set-dv-bt-timings=cvt,{size},fps={FPS}")
        v4l2_ctl(name, "--set-ctrl=loop_video=1,osd_text_mode=2")
        stream = (f"--set-fmt-video-out={size},pixelformat=GREY", "--stream-out-mmap", "--stream-from=-")
        with subprocess.Popen(
            ["v4l2-ctl", "-d", OUTPUT, *stream], stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, bufsize=0
        ) as writer:
            pipe = writer.stdin
            assert pipe is not None
            try:
                yield name, lambda picture: pipe.write(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).tobytes())
            finally:
                writer.terminate()
