"""The looks of a dome from inside, and one sensor as it really is, written beside its datasets."""

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
    """What makes one sensor's pictures differ from another's.

    skin_bgr, bead_bgr: as seen where the light is full; outside_grey: round the dome;
    bead_flatness: a bead's half axis along the dome's normal over the one across it (1 is a ball);
    highlight: 0 to 1, of the light's mirror image on a bead; softness_px: sigma of the lens's blur;
    leds, led_ring_mm, led_ahead_mm: LEDs on a ring round the camera, so far ahead of it;
    led_unevenness: share by which single LEDs are weaker; vignetting: the lens darkens with this
    power of the cosine of the angle from its axis; glints: 0 to 1, the LEDs' mirror images on the skin;
    glare: 0 to 1, of a broad bright patch; ambient: light through the skin, in parts of the LEDs';
    ambient_patches: how many; text, text_contrast: print that shows through; dust: specks on the skin;
    flicker: standard deviation of a frame's brightness, relative; noise_grey: of a pixel;
    jpeg_quality: of files; seed: of everything above that is random but the same in every frame.
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
    text: str = ""
    text_contrast: float = 0.1
    dust: int = 3
    flicker: float = 0.03
    noise_grey: float = 2.0
    jpeg_quality: int = 90
    seed: int = 0


class TwinSensor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One sensor with its tolerances: what a press dataset's sensor.toml does not tell.

    sensor: as sensor.toml describes it; pose: the camera as it is; bead_mm: centres in F, in any order;
    bead_size: diameter of each over the nominal one; shear_modulus_N_mm2: of the silicone.
    """

    sensor: Sensor
    pose: CameraPose
    bead_mm: tuple[Point, ...]
    bead_size: tuple[float, ...]
    shear_modulus_N_mm2: float
    look: Look


def save_twin(twin: TwinSensor, path: Path) -> None:
    write_atomically(path, msgspec.json.format(msgspec.json.encode(twin)) + b"\n", ConfigError)


def load_twin(path: Path) -> TwinSensor:
    """Read a twin.json. Raises ConfigError naming file and key."""
    twin = read_json(path, TwinSensor, guide="make it with palpate-host simulate dataset")
    if len(twin.bead_mm) != len(twin.bead_size) or not twin.bead_mm:
        raise ConfigError(
            f"{path}: bead_mm has {len(twin.bead_mm)} beads, bead_size {len(twin.bead_size)}: "
            "make it again with palpate-host simulate dataset"
        )
    return twin
