"""The text of a finger.toml, and of the sensor.toml beside it, from what was chosen; pure."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path

from palpate_edge.setup.found import FoundBus, FoundCamera

SENSOR = Path(__file__).with_name("sensor.toml")
"""Description of the sensor of docs/building.md."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SetupChoices:
    """The choices that a finger.toml is made from.

    dataset: folder for reference frames and presses, with a sensor.toml. exposure_us: None leaves the
    camera's. i2c_bus: None without an illumination controller.
    """

    name: str
    camera: FoundCamera
    bus: FoundBus
    node_id: int
    dataset: str
    exposure_us: int | None = None
    i2c_bus: int | None = None


def finger_toml(choices: SetupChoices) -> str:
    """Return the text of the configuration."""
    camera, bus = choices.camera, choices.bus
    lines = [
        "# Written by palpate-edge setup. Every key: palpate-host docs configuration",
        f"name = {_quoted(choices.name)}",
        "",
        "[capture]",
        f"source = {_quoted(camera.source)}",
        f"path = {_quoted(camera.path)}",
    ]
    if camera.source == "recorded":
        lines.append("loop = true")
    if camera.source == "v4l2" and choices.exposure_us is not None:
        lines += ["", "[capture.camera]", f"exposure_us = {choices.exposure_us}"]
    lines += [
        "",
        "[estimator]",
        f"sensor = {_quoted(choices.dataset + '/sensor.toml')}",
        f"calibration = {_quoted(choices.name + '.cal')}",
        "calibration_required = false   # until it is made, the daemon runs and no contact is valid",
        "",
        "[node]",
        f"id = 0x{choices.node_id:02X}",
        f"parameters = {_quoted(choices.name + '.parameters')}",
        "",
        "[bus]",
        f"interface = {_quoted(bus.interface)}",
        *([f"channel = {_quoted(bus.channel)}"] if bus.channel else []),
    ]
    if choices.i2c_bus is not None:
        lines += ["", "[illumination]", f"i2c_bus = {choices.i2c_bus}"]
    return "\n".join(lines) + "\n"


def scaled_sensor_toml(template: str, size_px: tuple[int, int]) -> str:
    """Return a sensor.toml for images of another size: the camera matrix is scaled with the height."""
    width, height = size_px
    found = re.search(r"^width = (\d+)\nheight = (\d+)$", template, re.MULTILINE)
    matrix = re.search(r"^matrix = \[([\d., ]+)\]", template, re.MULTILINE)
    assert found is not None and matrix is not None
    if (width, height) == (int(found[1]), int(found[2])):
        return template
    focal = float(matrix[1].split(",")[0]) * height / int(found[2])
    sized = template.replace(found[0], f"width = {width}\nheight = {height}")
    return sized.replace(matrix[0], f"matrix = [{focal:.1f}, {focal:.1f}, {width / 2:.1f}, {height / 2:.1f}]")


def _quoted(text: str) -> str:
    """Return a TOML basic string; its escapes are those of JSON."""
    return json.dumps(text, ensure_ascii=False)
