"""Random sensors: layout, tolerances, silicone and appearance vary as much as between real sensors."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.geometry.sensor import Camera, CameraPose, Dome, Markers, Sensor, bead_layout_mm
from palpate_twin.camera import layouts
from palpate_twin.camera.look import Colour, Look, TwinSensor

WALL_SHARE = 1 / 6  # wall over outer radius; the only ratio in the field library
BEAD_SPHERE_SHARE = 26.5 / 30.0
USUAL_RADIUS_MM = 30.0
SHEAR_MODULI_N_MM2 = (0.06, 0.25)
BEAD_SCATTER_MM = (0.0, 0.2)  # standard deviation of bead positions
BEAD_SIZE_SCATTER = 0.04
OPENING_PX = (185.0, 222.0)  # radius of the dome's opening in the image
DARK, LIGHT, COLOURED = "dark", "light", "coloured"
COLOURS: tuple[Colour, ...] = ((40, 40, 205), (200, 90, 30), (50, 160, 40), (40, 190, 215))  # red to yellow
WORDS = ("PALPATE", "Table 4", "12:34 kg", "FRAGILE", "M3 x 12")


def random_sensor(seed: int, layout: str | None = None) -> TwinSensor:
    """Return a random sensor.

    layout: one of :data:`layouts.NAMES`; None selects from :data:`layouts.IN_TURN` by `seed`.
    The nominal sensor is random, as are tolerances and appearance (:func:`with_tolerances`).
    """
    rng = np.random.default_rng([seed, 0])
    name = layout or layouts.IN_TURN[seed % len(layouts.IN_TURN)]
    size = 1.0 if rng.uniform() < 0.6 else float(rng.uniform(0.66, 1.2))
    radius_mm = round(USUAL_RADIUS_MM * size, 2)
    markers = Markers(
        radius_mm=round(radius_mm * BEAD_SPHERE_SHARE, 3),
        diameter_mm=round(layouts.DIAMETER_MM.get(name, layouts.USUAL_DIAMETER_MM) * size, 2),
        rings=layouts.rings(name, 0.0 if rng.uniform() < 0.5 else round(float(rng.uniform(0, 360)), 1)),
    )
    dome = Dome(radius_mm, round(radius_mm * WALL_SHARE, 3))
    sensor = Sensor(dome, markers, _camera(radius_mm * (1 - WALL_SHARE), rng))
    if name in layouts.HEXAGONAL:
        directions = layouts.hexagonal_directions(*layouts.HEXAGONAL[name], float(rng.uniform(0, 60)))
        return with_tolerances(sensor, seed, markers.radius_mm * directions)
    return with_tolerances(sensor, seed)


def with_tolerances(sensor: Sensor, seed: int, layout_mm: Array | None = None) -> TwinSensor:
    """Return a nominal sensor with random tolerances, silicone and appearance.

    layout_mm (n, 3): nominal bead positions if the sensor has no rings.
    """
    rng = np.random.default_rng([seed, 1])
    ideal_mm = bead_layout_mm(sensor.markers)[0] if layout_mm is None else layout_mm
    scatter_mm = float(rng.uniform(*BEAD_SCATTER_MM)) * sensor.dome.outer_radius_mm / USUAL_RADIUS_MM
    beads = ideal_mm + scatter_mm * rng.standard_normal(ideal_mm.shape)
    beads *= sensor.markers.radius_mm / np.linalg.norm(beads, axis=1, keepdims=True)
    size = np.clip(1 + BEAD_SIZE_SCATTER * rng.standard_normal(len(beads)), 0.85, 1.15)
    offset_mm, tilt_rad = rng.uniform(-1, 1, 3), np.radians(rng.uniform(-2, 2, 3))
    pose = CameraPose(
        (float(offset_mm[0]), float(offset_mm[1]), float(offset_mm[2])),
        (float(tilt_rad[0]), float(tilt_rad[1]), float(tilt_rad[2])),
        float(rng.uniform(0.97, 1.03)),
    )
    low, high = np.log(SHEAR_MODULI_N_MM2)
    return TwinSensor(
        sensor=sensor,
        pose=pose,
        bead_mm=tuple((float(x), float(y), float(z)) for x, y, z in np.round(beads, 4)),
        bead_size=tuple(float(share) for share in np.round(size, 4)),
        shear_modulus_N_mm2=round(float(np.exp(rng.uniform(low, high))), 4),
        look=_look(sensor, seed, rng),
    )


def _camera(opening_mm: float, rng: np.random.Generator) -> Camera:
    """Return a camera on the axis whose image the dome's opening fills: pinhole, or fisheye and closer."""
    reach_px = float(rng.uniform(*OPENING_PX))
    fisheye = bool(rng.uniform() < 0.3)
    distance_mm = opening_mm * float(rng.uniform(0.6, 1.2) if fisheye else rng.uniform(1.5, 2.4))
    if fisheye:
        focal_px = reach_px / np.arctan2(opening_mm, distance_mm)
        distortion = rng.uniform(-0.02, 0.02, 4) * [1, 1, 0.2, 0.05]
    else:
        focal_px = reach_px * distance_mm / opening_mm
        distortion = np.array([rng.uniform(-0.08, 0.04), 0.0, 0.0, 0.0])
    focal_px = round(float(focal_px), 1)
    centre_px = np.round(np.array([320.0, 240.0]) + rng.uniform(-6, 6, 2), 1)
    return Camera(
        width=640,
        height=480,
        matrix=(focal_px, focal_px, float(centre_px[0]), float(centre_px[1])),
        position_mm=(0.0, 0.0, -round(distance_mm, 1)),
        fps=30.0,
        model="fisheye" if fisheye else "pinhole",
        distortion=tuple(float(value) for value in np.round(distortion, 5)),
    )


def _look(sensor: Sensor, seed: int, rng: np.random.Generator) -> Look:
    kind = str(rng.choice([DARK, LIGHT, COLOURED], p=[0.5, 0.25, 0.25]))
    skin, bead = _colours(kind, rng)
    glare = float(rng.uniform(0.1, 0.5)) if rng.uniform() < 0.2 else 0.0
    return Look(
        skin_bgr=skin,
        bead_bgr=bead,
        outside_grey=float(rng.uniform(5, 30)),
        bead_flatness=float(rng.uniform(0.5, 1.0)),
        highlight=float(rng.uniform(0, 0.5)),
        softness_px=float(rng.uniform(0.5, 1.2)),
        leds=int(rng.choice([4, 6, 8])),
        led_ring_mm=float(rng.uniform(4, 9)),
        led_ahead_mm=float(rng.uniform(0, 5)),
        led_unevenness=float(rng.uniform(0, 0.4)),
        vignetting=float(rng.uniform(0.3, 1.0) if sensor.camera.model == "fisheye" else rng.uniform(1, 4)),
        glints=float(rng.uniform(0, 1)),
        glare=glare,
        ambient=float(rng.uniform(0, 0.3)),
        ambient_patches=int(rng.integers(0, 4)),
        text=str(rng.choice(WORDS)) if rng.uniform() < 0.3 else "",
        text_contrast=float(rng.uniform(0.05, 0.25)),
        dust=int(rng.integers(0, 8)),
        flicker=float(rng.uniform(0, 0.05)),
        noise_grey=float(rng.uniform(1, 3.5)),
        jpeg_quality=int(rng.integers(80, 97)),
        seed=seed,
    )


def _colours(kind: str, rng: np.random.Generator) -> tuple[Colour, Colour]:
    """Return the colours of skin and beads: tinted greys, or coloured beads."""
    if kind == LIGHT:
        return _grey(rng.uniform(40, 80), 10, rng), _grey(rng.uniform(180, 220), 8, rng)
    skin = _grey(rng.uniform(150, 185), 12, rng)
    if kind == DARK:
        return skin, _grey(rng.uniform(25, 60), 6, rng)
    return skin, COLOURS[int(rng.integers(len(COLOURS)))]


def _grey(level: float, tint: float, rng: np.random.Generator) -> Colour:
    blue, green, red = np.round(level + rng.uniform(-tint, tint, 3), 1)
    return float(blue), float(green), float(red)
