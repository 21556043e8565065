"""The rendered frame: bead positions, shading, deformation, determinism, and each property of `Look`."""

from __future__ import annotations

from itertools import pairwise

import cv2
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import ConfigError
from palpate_edge.geometry.sensor import Camera, CameraPose, Dome, Markers, Ring, Sensor, bead_layout_mm
from palpate_twin.camera.deformation import (
    DeformableDome,
    ProbePress,
    skin_directions,
    turned_rings,
)
from palpate_twin.camera.hard_looks import with_properties
from palpate_twin.camera.layouts import IN_TURN
from palpate_twin.camera.look import Look, TwinSensor
from palpate_twin.camera.random_presses import CYCLE_S, moving_press, random_press
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome import field_grid
from palpate_twin.dome.library import FieldLibrary, load_library
from palpate_twin.dome.probe import Probe

SENSOR = Sensor(
    Dome(30.0, 5.0),
    Markers(26.5, 3.0, (Ring(0, 1), Ring(25, 6), Ring(50, 12), Ring(75, 18))),
    Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0)),
)
QUIET = Look(flicker=0.0, noise_grey=0.0, ambient=0.0, ambient_patches=0, dust=0, glints=0.0, highlight=0.0)
PRESS = ProbePress(0.6, 2.0, 2.5, (0.3, -0.4))


@pytest.fixture(scope="module")
def library() -> FieldLibrary:
    return load_library()


def _twin(look: Look = QUIET, pose: CameraPose | None = None) -> TwinSensor:
    beads = bead_layout_mm(SENSOR.markers)[0]
    places = tuple((float(x), float(y), float(z)) for x, y, z in beads)
    return TwinSensor(SENSOR, pose or CameraPose(), places, (1.0,) * len(beads), 0.13, look)


def _rng() -> np.random.Generator:
    return np.random.default_rng(0)


def _centroids(image: Image, expected_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the centroids of the dark blobs near the expected positions, weighted by darkness."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float64)
    found = []
    for x, y in np.rint(expected_px).astype(int):
        window = grey[y - 15 : y + 16, x - 15 : x + 16]
        skin = np.median(np.concatenate([window[0], window[-1], window[:, 0], window[:, -1]]))
        dark = np.clip((skin - window) / (skin - window.min()) - 0.1, 0, None)
        rows, columns = np.mgrid[-15:16, -15:16]
        found.append([x + (dark * columns).sum() / dark.sum(), y + (dark * rows).sum() / dark.sum()])
    return np.array(found)


def test_beads_of_a_pressed_dome_are_where_the_field_and_opencv_put_them(library: FieldLibrary) -> None:
    twin = _twin()
    image, _ = CameraView(twin, library).frame(PRESS, _rng())
    beads = np.array(twin.bead_mm)
    inner = beads[:19]  # the outermost are cut by the opening
    field = library.field(beads / 26.5, PRESS.theta_rad, PRESS.depth_mm, PRESS.shear_mm, PRESS.azimuth_rad)
    moved = inner + field.displacement_mm[:19]
    matrix = np.array([[380.0, 0, 320], [0, 380, 240], [0, 0, 1]])
    expected, _ = cv2.projectPoints(moved - [0, 0, -45.0], np.zeros(3), np.zeros(3), matrix, None)
    off = _centroids(image, expected.reshape(-1, 2)) - expected.reshape(-1, 2)
    assert (
        np.linalg.norm(off, axis=1).max() < 0.3
    )  # perspective moves a ball's outline by 0.1 px, uneven light the centroid
    at_rest, _ = cv2.projectPoints(inner - [0, 0, -45.0], np.zeros(3), np.zeros(3), matrix, None)
    assert np.linalg.norm((expected - at_rest).reshape(-1, 2), axis=1).max() > 5


def test_fields_turned_by_phases_are_the_library_s_own(library: FieldLibrary) -> None:
    rng = np.random.default_rng(1)
    beads = bead_layout_mm(SENSOR.markers)[0] / 26.5
    dome = DeformableDome(library, SENSOR.dome, beads)
    for _ in range(10):
        press = random_press(dome, (Probe.PLATE, Probe.SPHERE5), rng)
        theirs = library.field(
            beads, press.theta_rad, press.depth_mm, press.shear_mm, press.azimuth_rad, press.probe
        )
        ours = dome.press(press)
        assert ours.bead_mm == pytest.approx(theirs.displacement_mm, abs=2e-3 * press.depth_mm)
        assert ours.force_per_mu_mm2 == pytest.approx(theirs.force_per_mu_mm2, rel=1e-9)


def test_a_ring_turned_by_its_own_spacing_is_shifted_by_one_place() -> None:
    values = np.random.default_rng(0).standard_normal((len(field_grid.ring_directions()), 2))
    turned = turned_rings(values, 2 * np.pi / field_grid.POINTS_A_RING)
    assert turned[1, ::9] == pytest.approx(np.roll(values[1:9], 1, axis=0))
    assert turned[3, ::3] == pytest.approx(np.roll(values[25:49], 3, axis=0))
    assert turned[9] == pytest.approx(np.roll(values[-72:], 9, axis=0))
    assert turned[0] == pytest.approx(np.tile(values[0], (72, 1)))


def test_the_skin_between_a_ring_s_points_is_the_library_s_own(library: FieldLibrary) -> None:
    """Inner rings have fewer points than the skin's grid."""
    press = ProbePress(0.6, 2.0, 2.0, (0.3, 0.2))
    skin = DeformableDome(library, SENSOR.dome, skin_directions()[3]).press(press).skin_mm
    for ring in (1, 2, 5, 9):
        theirs = library.field(
            skin_directions()[ring], press.theta_rad, press.depth_mm, press.shear_mm, press.azimuth_rad
        )
        assert skin[ring] == pytest.approx(theirs.displacement_mm, abs=2e-3 * press.depth_mm)


def test_a_dome_half_as_large_is_the_same_dome_drawn_small(library: FieldLibrary) -> None:
    directions = skin_directions()[3]
    large = DeformableDome(library, Dome(30.0, 5.0), directions).press(ProbePress(0.5, 1.0, 2.0, (0.2, 0.1)))
    small = DeformableDome(library, Dome(15.0, 2.5), directions).press(ProbePress(0.5, 1.0, 1.0, (0.1, 0.05)))
    assert small.bead_mm == pytest.approx(large.bead_mm / 2)
    assert small.force_per_mu_mm2 == pytest.approx(large.force_per_mu_mm2 / 4)


def test_a_wall_that_the_library_does_not_have_is_refused(library: FieldLibrary) -> None:
    with pytest.raises(ConfigError, match=r"dome\.wall_mm = 3 cannot be simulated"):
        DeformableDome(library, Dome(30.0, 3.0), skin_directions()[1])


def test_force_is_the_library_s_times_the_stiffness(library: FieldLibrary) -> None:
    twin = _twin()
    _, force_N = CameraView(twin, library).frame(PRESS, _rng())
    stiffer = msgspec.structs.replace(twin, shear_modulus_N_mm2=0.26)
    _, twice_N = CameraView(stiffer, library).frame(PRESS, _rng())
    assert -force_N @ PRESS.outward > 0.5
    assert twice_N == pytest.approx(2 * force_N)


def test_skin_is_darker_farther_from_the_lights(library: FieldLibrary) -> None:
    """The brightest pixels of each circle about the middle show skin between the beads."""
    far = msgspec.structs.replace(QUIET, led_unevenness=0.0)
    image, _ = CameraView(_twin(far), library).frame(None, _rng())
    blank = cv2.medianBlur(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), 5).astype(float)
    ring = [
        np.percentile(
            [blank[round(240 + r * np.sin(a)), round(320 + r * np.cos(a))] for a in np.arange(0, 6.28, 0.05)],
            90,
        )
        for r in (20, 60, 100, 140, 180)
    ]
    from_led = np.diff(ring)
    assert (from_led < 0).all(), ring
    assert blank[10, 10] < 30


def _middle_light(view: CameraView, press: ProbePress | None) -> float:
    """Return the light in the middle of the image, relative to the brightest point without touch."""
    part = view._part
    light = view._light.untouched() if press is None else view._light.pressed(view.dome.press(press).skin_mm)
    return float(light[(240 - part.top) // 8, (320 - part.left) // 8, 1])


def test_skin_pushed_towards_the_lights_is_brighter(library: FieldLibrary) -> None:
    view = CameraView(_twin(), library)
    apex, side = ProbePress(0.0, 0.0, 3.5), ProbePress(1.2, 0.0, 1.0)
    assert _middle_light(view, apex) > 1.02 * _middle_light(view, None)
    assert _middle_light(view, side) == pytest.approx(_middle_light(view, None), rel=0.01)


def test_a_press_that_hardly_moves_the_skin_leaves_the_picture_as_it_is(library: FieldLibrary) -> None:
    """Down to the base, where the light grazes the skin."""
    view = CameraView(_twin(), library)
    untouched, touched = (view.frame(press, _rng())[0] for press in (None, ProbePress(0.0, 0.0, 1e-6)))
    np.testing.assert_array_equal(touched, untouched)


def test_ambient_light_is_kept_out_where_something_touches(library: FieldLibrary) -> None:
    lit, unlit = (
        CameraView(_twin(msgspec.structs.replace(QUIET, ambient=share)), library) for share in (0.8, 0.0)
    )
    apex = ProbePress(0.0, 0.0, 3.5)
    untouched = _middle_light(lit, None) - _middle_light(unlit, None)
    under_the_plate = _middle_light(lit, apex) - _middle_light(unlit, apex)
    assert under_the_plate < 0.3 * untouched


def test_a_camera_that_does_not_see_the_dome_is_refused(library: FieldLibrary) -> None:
    away = msgspec.structs.replace(SENSOR.camera, matrix=(380.0, 380.0, 3200.0, 240.0))
    sensor = msgspec.structs.replace(SENSOR, camera=away)
    with pytest.raises(ConfigError, match="does not see the dome"):
        CameraView(msgspec.structs.replace(_twin(), sensor=sensor), library)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(library: FieldLibrary) -> None:
    frames = []
    for seed in (3, 3, 4):
        view = CameraView(random_sensor(seed), library)
        rng = np.random.default_rng(9)
        view.frame(None, rng)
        frames.append(view.frame(random_press(view.dome, (Probe.PLATE,), np.random.default_rng(1)), rng)[0])
    assert np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[0], frames[2])


def test_noise_has_its_standard_deviation_and_flicker_its_own(library: FieldLibrary) -> None:
    noisy = CameraView(_twin(msgspec.structs.replace(QUIET, noise_grey=3.0)), library)
    rng = _rng()
    frames = np.stack([noisy.frame(None, rng)[0][200:280, 280:310].astype(float) for _ in range(40)])
    assert frames.std(axis=0).mean() == pytest.approx(3.0, rel=0.1)
    flickering = CameraView(_twin(msgspec.structs.replace(QUIET, flicker=0.05)), library)
    means = [flickering.frame(None, rng)[0][200:280, 280:310].mean() for _ in range(60)]
    assert np.std(means) / np.mean(means) == pytest.approx(0.05, rel=0.3)


def test_hidden_beads_are_skin_and_exposure_multiplies_light(library: FieldLibrary) -> None:
    view = CameraView(_twin(), library)
    seen, _ = view.frame(None, _rng())
    hidden, _ = view.frame(None, _rng(), hidden=(0,))
    assert seen[240, 320, 1] < 60
    assert hidden[240, 320, 1] > 120
    assert np.array_equal(seen[:200], hidden[:200])
    dim, _ = view.frame(None, _rng(), exposure=0.5)
    assert dim[200, 320, 1] == pytest.approx(seen[200, 320, 1] / 2, abs=3)


@pytest.mark.parametrize(
    "change", [{"text": "PALPATE"}, {"glare": 0.5}, {"glints": 1.0}, {"dust": 8}, {"highlight": 1.0}]
)
def test_each_look_shows_in_the_picture(library: FieldLibrary, change: dict[str, object]) -> None:
    plain, _ = CameraView(_twin(), library).frame(None, _rng())
    other, _ = CameraView(_twin(msgspec.structs.replace(QUIET, **change)), library).frame(None, _rng())
    assert np.abs(plain.astype(int) - other).max() > 8


def test_a_veil_lowers_contrast_and_exposure_clips(library: FieldLibrary) -> None:
    """Grey of a bead and of the skin near it: 36 and 176 of :class:`Look`, in light of almost 1."""
    bead, skin = (slice(238, 243), slice(318, 323)), (slice(238, 243), slice(345, 350))

    def greys(**change: object) -> tuple[float, float]:
        twin = _twin(msgspec.structs.replace(QUIET, **change))
        image, _ = CameraView(twin, library).frame(None, _rng())
        return float(image[bead].mean()), float(image[skin].mean())

    dark, light = greys()
    veiled_dark, veiled_light = greys(veil=0.6)
    assert veiled_light - veiled_dark == pytest.approx(0.4 * (light - dark), rel=0.1)
    assert veiled_dark > dark + 50
    bright_dark, bright_light = greys(exposure=2.0)
    assert bright_dark == pytest.approx(2 * dark, rel=0.05)
    assert bright_light == 255


def test_changing_light_is_another_in_every_frame(library: FieldLibrary) -> None:
    view, rng = CameraView(_twin(msgspec.structs.replace(QUIET, changing_light=1.0)), library), _rng()
    first, second = (view.frame(None, rng)[0].astype(int) for _ in range(2))
    assert np.abs(first - second).max() > 20
    constant = CameraView(_twin(), library)
    assert np.array_equal(constant.frame(None, rng)[0], constant.frame(None, rng)[0])


def test_properties_of_a_look_by_name() -> None:
    look = with_properties(Look(), ["veil", "bead_bgr=red", "skin_bgr=1,2,3", "veil=0.25", "dust=7"])
    assert (look.veil, look.jpeg_quality, look.dust) == (0.25, 60, 7)
    assert look.bead_bgr[2] > 150 > look.bead_bgr[0]
    assert look.skin_bgr == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fog", "no such look"),
        ("fog=1", "no such look"),
        ("veil=much", "veil = "),
        ("bead_bgr=1,2", "bead_bgr has"),
    ],
)
def test_an_unknown_property_of_a_look_is_named(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        with_properties(Look(), [text])


@pytest.mark.parametrize("seed", range(len(IN_TURN)))
def test_random_sensors_show_all_their_beads(library: FieldLibrary, seed: int) -> None:
    twin = random_sensor(seed)
    centre_px, _ = CameraView(twin, library).outlines(None)
    assert len(centre_px) == {0: 85, 1: 85, 2: 85, 3: 127, 4: 331}[seed]
    assert (centre_px > 5).all()
    assert (centre_px < [635, 475]).all()


def test_a_moving_contact_rests_presses_and_leaves_smoothly(library: FieldLibrary) -> None:
    dome = DeformableDome(library, SENSOR.dome, skin_directions()[2])
    presses = [moving_press(dome, (Probe.PLATE,), t, 5) for t in np.arange(0, 4 * CYCLE_S, 0.01)]
    depth = np.array([press.depth_mm if press else 0.0 for press in presses])
    assert (depth == 0).mean() == pytest.approx(0.2, abs=0.02)
    assert np.abs(np.diff(depth)).max() < 0.12
    assert sum(b > 0 >= a for a, b in pairwise(depth)) == 4
    for press in presses:
        if press is not None:
            dome.press(press)  # raises if outside of the library
