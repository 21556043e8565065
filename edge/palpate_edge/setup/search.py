"""The search for cameras, CAN interfaces and illumination controllers; nothing is sent to a bus or moved."""

from __future__ import annotations

import re
from contextlib import closing
from pathlib import Path

from palpate_edge.capture.frame_ring import RingReader
from palpate_edge.capture.v4l2.controls import EXPOSURE, GAIN, WHITE_BALANCE
from palpate_edge.capture.v4l2.device import VideoDevice
from palpate_edge.capture.v4l2.formats import PixelCode
from palpate_edge.capture.v4l2.naming import BY_PATH
from palpate_edge.capture.v4l2.negotiate import four_characters
from palpate_edge.common.errors import CaptureError, IlluminationError, PalpateError
from palpate_edge.datasets.images import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from palpate_edge.datasets.press_dataset import is_dataset
from palpate_edge.datasets.recording import open_recording
from palpate_edge.illumination.client import IlluminationClient
from palpate_edge.setup.found import FoundBus, FoundCamera, FoundLight

SHARED_MEMORY = Path("/dev/shm")
RINGS = "palpate-*"
NETWORK = Path("/sys/class/net")
ARPHRD_CAN = "280"  # linux/if_arp.h
I2C = Path("/dev")


def find_cameras(
    folder: Path, by_path: Path = BY_PATH, shared_memory: Path = SHARED_MEMORY
) -> list[FoundCamera]:
    """Return V4L2 cameras, then the recordings in `folder`, then the rings of simulated cameras."""
    cameras = [_v4l2(link) for link in sorted(by_path.glob("*-index0"))]
    rings = [_ring(path) for path in sorted(shared_memory.glob(RINGS))]
    recordings = [_recording(path) for path in sorted(folder.iterdir()) if _may_be_recording(path)]
    return [*cameras, *(found for found in (*recordings, *rings) if found is not None)]


def find_buses(network: Path = NETWORK) -> list[FoundBus]:
    """Return the kernel's CAN interfaces, then the local hub, which is always possible."""
    found = []
    for interface in sorted(network.iterdir()) if network.is_dir() else []:
        if _text(interface / "type") == ARPHRD_CAN:
            state = _text(interface / "operstate") or "unknown"
            is_down = state not in ("up", "unknown")
            way_out = f"; ip link set {interface.name} up" if is_down else ""
            found.append(FoundBus("socketcan", interface.name, f"{state}{way_out}", is_down))
    return [*found, FoundBus("palpate", "", "the local hub: palpate-host bus hub")]


def find_lights(devices: Path = I2C) -> list[FoundLight]:
    """Return the I2C buses, each with whether an illumination controller answers at the default address."""
    numbers = [
        int(match[1]) for path in devices.glob("i2c-*") if (match := re.fullmatch(r"i2c-(\d+)", path.name))
    ]
    return [FoundLight(number, _light_problem(number)) for number in sorted(numbers)]


def _light_problem(number: int) -> str:
    try:
        IlluminationClient.open(number).close()
    except IlluminationError as error:
        return str(error)
    return ""


def _v4l2(link: Path) -> FoundCamera:
    try:
        with closing(VideoDevice(link)) as device:
            card = device.capabilities.card.decode("latin-1")
            known = [code.fourcc for code in PixelCode]
            formats = [fourcc for fourcc in device.formats() if fourcc in known]
            sizes = {size for fourcc in formats for size in device.sizes(fourcc)}
            controls = [
                f"{control.name} {query.minimum} to {query.maximum}"
                for control in (EXPOSURE, GAIN, WHITE_BALANCE)
                if (query := device.query_control(control.control_id)) is not None
            ]
    except CaptureError as error:
        return FoundCamera("v4l2", str(link), "camera", problem=str(error))
    names = "/".join(four_characters(fourcc) for fourcc in formats) or "no format that is known"
    text = f"{card}, {names}, {' '.join(f'{w}x{h}' for w, h in sorted(sizes)) or 'any size'}"
    size = next(iter(sizes)) if len(sizes) == 1 else None
    problem = "" if formats else "none of GREY, NV12, YU12, YUYV, MJPG"
    return FoundCamera("v4l2", str(link), f"{text}; {', '.join(controls) or 'no controls'}", size, problem)


def _ring(path: Path) -> FoundCamera | None:
    try:
        with closing(RingReader(path)) as reader:
            form = reader.format
    except (CaptureError, OSError):  # another program's file
        return None
    size = (form.width, form.height)
    return FoundCamera("shared_memory", str(path), f"simulated camera, {form.width}x{form.height}", size)


def _may_be_recording(path: Path) -> bool:
    if path.is_dir():
        return is_dataset(path) or any(one.suffix.lower() in IMAGE_SUFFIXES for one in path.iterdir())
    return path.suffix.lower() in VIDEO_SUFFIXES


def _recording(path: Path) -> FoundCamera | None:
    try:
        with closing(open_recording(path, grey=False)) as recording:
            image, _ = recording.read(0)
            count = recording.count
    except PalpateError:
        return None
    height, width = image.shape[:2]
    return FoundCamera(
        "recorded", str(path), f"recording of {count} frames, {width}x{height}", (width, height)
    )


def _text(file: Path) -> str | None:
    try:
        return file.read_text().strip()
    except OSError:
        return None
