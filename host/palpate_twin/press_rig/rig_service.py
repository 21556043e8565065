"""A simulated press rig in real time, or faster: printer and scale on pseudo terminals, frames in a ring."""

from __future__ import annotations

import os
import time
import tty
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from threading import Event

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.errors import ConfigError, reason_of
from palpate_edge.common.local_clock import monotonic_us
from palpate_edge.geometry.sensor import Sensor
from palpate_twin.camera.look import TWIN_FILE, save_twin
from palpate_twin.camera.write_dataset import sensor_toml
from palpate_twin.press_rig.virtual_rig import VirtualRig

PAUSE_S = 0.001
APEX_MM = (110.0, 105.0, 60.0)
BOX_MM = ((40.0, 40.0, 10.0), (180.0, 180.0, 90.0))
MOST_BYTES = 4096


def write_rig_files(folder: Path, rig: VirtualRig) -> None:
    """Write sensor.toml, twin.json, finger.toml and rig.toml for a simulated rig.

    Raises ConfigError when the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "sensor.toml").write_text(sensor_toml(rig.view.twin.sensor), encoding="utf-8")
        save_twin(rig.view.twin, folder / TWIN_FILE)
        (folder / "finger.toml").write_text(_finger_toml(), encoding="utf-8")
        (folder / "rig.toml").write_text(_rig_toml(folder.resolve(), rig.view.twin.sensor), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{folder} cannot be written: {reason_of(error)}; give another path") from None


def _finger_toml() -> str:
    return """name = "press-rig"

[capture]
source = "shared_memory"
path = "frames.ring"

[estimator]
sensor = "sensor.toml"
calibration = "press-rig.cal"
calibration_required = false

[node]
id = 0x10

[bus]
interface = "palpate"
"""


def _rig_toml(folder: Path, sensor: Sensor) -> str:
    low_mm, high_mm = (list(corner) for corner in BOX_MM)
    depth_mm = min(3.5, 0.117 * sensor.dome.outer_radius_mm)
    return f"""[printer]
port = "{folder / "printer"}"

[scale]
port = "{folder / "scale"}"
settling = 12

[box]
low_mm = {low_mm}
high_mm = {high_mm}

[presses]
apex_mm = {list(APEX_MM)}
theta_deg = 65.0
depth_mm = {depth_mm:.2f}
"""


def serve_rig(folder: Path, rig: VirtualRig, stop: Event, speed: float) -> None:
    """Serve the devices in a folder until `stop` is set.

    speed: simulated seconds in one second. Raises ConfigError or CaptureError when the folder refuses them.
    """
    camera = rig.view.twin.sensor.camera
    form = RingFormat(camera.width, camera.height, 3, fingerprint=rig.view.twin.sensor.fingerprint())
    period_us = round(1e6 / camera.fps)
    with ExitStack() as stack:
        printer = stack.enter_context(_terminal(folder / "printer"))
        scale = stack.enter_context(_terminal(folder / "scale"))
        ring = stack.enter_context(closing(RingWriter(folder / "frames.ring", form)))
        start_us = next_us = monotonic_us()
        sequence = 0
        while not stop.is_set():
            now_us = monotonic_us()
            simulated_us = round((now_us - start_us) * speed)
            to_host, weights = rig.advance(simulated_us, _read(printer))
            _write(printer, to_host)
            _write(scale, weights)
            if now_us >= next_us:
                ring.write(rig.picture(), sequence, now_us)
                sequence += 1
                next_us = now_us + period_us
            time.sleep(PAUSE_S)


@contextmanager
def _terminal(link: Path) -> Iterator[int]:
    """Yield the simulator's end of a pseudo terminal; the other end is at `link` during the context."""
    inside, outside = os.openpty()
    tty.setraw(outside)
    os.set_blocking(inside, False)
    try:
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(outside))
    except OSError as error:
        raise ConfigError(f"{link} cannot be created: {reason_of(error)}; give another folder") from None
    try:
        yield inside
    finally:
        link.unlink(missing_ok=True)
        for descriptor in (inside, outside):
            os.close(descriptor)


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, MOST_BYTES)
    except BlockingIOError:
        return b""


def _write(terminal: int, data: bytes) -> None:
    """Write, or lose what does not fit, as a serial line does that nobody reads."""
    if data:
        with suppress(BlockingIOError):
            os.write(terminal, data)
