"""Appearance of a dome from inside, and the true properties of a simulated sensor (twin.json)."""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.config_file import read_json
from palpate_edge.common.errors import ConfigError
from palpate_edge.geometry.sensor import CameraPose, Sensor

Colour = tuple[float, float, float]  # B, G, R, 0 to 255
Point = tuple[float, float, float]

TWIN_FILE = "twin.json"


class Look(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Appearance of one sensor's images.

    skin_bgr, bead_bgr: colours under full light. outside_grey: grey level around the dome. bead_flatness:
    half axis of a bead along the dome's normal divided by the one across it (1 is a ball). highlight: 0 to 1,
    intensity of the light's reflection on a bead. softness_px: sigma of the lens blur. leds, led_ring_mm,
    led_ahead_mm: number of LEDs, radius of their ring around the camera, and its distance in front of the
    camera. led_unevenness: largest relative loss of power of a LED. vignetting: exponent of the cosine of the
    angle from the optical axis. glints: 0 to 1, intensity of the LEDs' reflections on the skin. glare: 0 to
    1, intensity of a broad bright patch. ambient: room light through the skin relative to the LEDs.
    ambient_patches: number of brighter patches of room light. changing_light: largest strength, relative to
    the LEDs, of patches of room light that are others in every frame. text, text_contrast: print that shows
    through the skin. dust, dust_contrast: number of specks on the skin, and how dark the darkest may be.
    veil: 0 to 1, share of haze in the image, which lowers all contrasts. exposure: of the camera; at 1
    skin under full light has the colour skin_bgr, and values above 255 are clipped. flicker: relative
    standard deviation of a frame's brightness. noise_grey: standard deviation of a pixel. jpeg_quality: of
    image files. seed: of all random properties that are the same in every frame.
    """

    skin_bgr: Colour = (176.0, 176.0, 190.0)
    bead_bgr: Colour = (38.0, 36.0, 38.0)
    outside_grey: float = 14.0
    bead_flatness: float = 0.8
    highlight: float = 0.2
    softness_px: float = 0.8
    leds: int = 4
    led_ring_mm: float = 6.0
    led_ahead_mm: float = 2.0
    led_unevenness: float = 0.1
    vignetting: float = 2.0
    glints: float = 0.8
    glare: float = 0.0
    ambient: float = 0.05
    ambient_patches: int = 2
    changing_light: float = 0.0
    text: str = ""
    text_contrast: float = 0.1
    dust: int = 3
    dust_contrast: float = 0.25
    veil: float = 0.0
    exposure: float = 1.0
    flicker: float = 0.03
    noise_grey: float = 2.0
    jpeg_quality: int = 90
    seed: int = 0


class TwinSensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A simulated sensor with its tolerances, which are not in the dataset's sensor.toml.

    sensor: nominal sensor of sensor.toml; pose: true camera pose; bead_mm: true centres in F, in any order;
    bead_size: diameter of each bead relative to the nominal one; shear_modulus_N_mm2: of the silicone;
    wall_unevenness: standard deviation of the logarithm of the wall's stiffness, drawn from look.seed.
    """

    sensor: Sensor
    pose: CameraPose
    bead_mm: tuple[Point, ...]
    bead_size: tuple[float, ...]
    shear_modulus_N_mm2: float
    look: Look
    wall_unevenness: float = 0.0


def save_twin(twin: TwinSensor, path: Path) -> None:
    """Write a twin.json. Raises ConfigError if it cannot be written."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(twin)) + b"\n", ConfigError)


def load_twin(path: Path) -> TwinSensor:
    """Read a twin.json. Raises ConfigError, naming file and key, if it is missing or invalid."""
    twin = read_json(path, TwinSensor, guide="make it with palpate-host simulate dataset")
    if len(twin.bead_mm) != len(twin.bead_size) or not twin.bead_mm:
        raise ConfigError(
            f"{path}: bead_mm has {len(twin.bead_mm)} beads, bead_size {len(twin.bead_size)}: "
            "make it again with palpate-host simulate dataset"
        )
    return twin
