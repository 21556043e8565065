"""Delay of the flag of the onset of slip, on finite elements with friction: ``python -m bench.slip_onset``.

A probe presses the dome and slides, or twists, until all of the contact slides. The solution gives the beads
at each step; they are read as camera frames at several speeds and frame rates, with the noise of the recorded
sensors, and pass through field, dome model and detector. Delays are from two moments: when all points that
touch slide, and when the load has reached its end, since the skin still moves with the probe in between.
A twist is measured as the way at 3 mm from its axis. Solving takes minutes; the paths are kept in the folder
`--paths`.
"""

from __future__ import annotations

import argparse
import pickle
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from palpate_edge.calibration.training.dome_model import DomeModel, load_dome_model
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.kernel_ridge import Regression, fit
from palpate_edge.common.arrays import Array
from palpate_edge.common.contact import Contact
from palpate_edge.estimation.displacement_field import DisplacementReader, MeanMotion
from palpate_edge.estimation.slip_onset import TORSION_RADIUS_MM, LoadHistory, detect_onset
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Markers, Ring, View, bead_layout_mm
from palpate_edge.vision.beads import Beads
from palpate_twin.dome.dome_samples import CAMERA, LAYOUTS
from palpate_twin.dome.equilibrium import ElasticDome
from palpate_twin.dome.mesh import Resolution, dome_mesh
from palpate_twin.dome.press import PressedDome, directions, press_path, twist_path
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.sampling import Sampler

THETA_RAD, RADIUS_MM, BEAD_RADIUS_MM = 0.3, 30.0, 26.5
DEPTHS_MM = (0.375, 0.75, 1.125, 1.5)
STEP_MM, TWIST_STEP_MM, STEPS = 1.6 / 30, 0.03, 30
TORSION_RIDGE = 1e-7
SHEAR_MODULUS = 0.25  # N/mm^2: about 2 N at the last depth
NOISE_PX = 0.02
SLIDING_MM, FULL = 1e-6, 0.99
SPEEDS_MM_S = (1.0, 5.0, 20.0)
FRAME_RATES = (30.0, 120.0)
BEFORE_S, AFTER_S = 0.3, 0.3
SEQUENCES = 10


@dataclass(frozen=True, slots=True)
class Kind:
    """One part of the table: probe that slides, or twists, and coefficient of friction."""

    name: str
    probe: Probe
    friction: float
    twists: bool = False

    @property
    def file_name(self) -> str:
        """File of the solved path."""
        return f"{self.probe.label}-{self.friction}{'-twist' * self.twists}.pickle"


KINDS = (
    Kind("flat face", Probe.PLATE, 0.5),
    Kind("ball of 10 mm", Probe.SPHERE10, 0.5),
    Kind("flat face", Probe.PLATE, 0.3),
    Kind("flat face", Probe.PLATE, 0.8),
    Kind("flat face that twists", Probe.PLATE, 0.5, twists=True),
)


@dataclass(frozen=True, slots=True)
class SlipPath:
    """One path: way_mm (s,) of the probe and beads_mm (s, n, 3), displaced.

    slides_mm: way when all of the contact slides; full_mm: when the load has reached its end.
    """

    way_mm: Array
    beads_mm: Array
    slides_mm: float
    full_mm: float


def solve(kind: Kind, beads_mm: Array) -> SlipPath:
    """Press the dome, then slide the probe towards the base, or twist it, which needs the whole dome."""
    mesh = dome_mesh(
        resolution=Resolution(6, 4, 1) if kind.twists else Resolution(8, 6, 1), half=not kind.twists
    )
    dome = ElasticDome(mesh, friction=kind.friction)
    *_, start = press_path(dome, THETA_RAD, [(depth, (0.0, 0.0)) for depth in DEPTHS_MM], kind.probe)
    way_mm = (TWIST_STEP_MM if kind.twists else STEP_MM) * np.arange(STEPS + 1)
    sample = Sampler(mesh, beads_mm)
    if kind.twists:
        moved = [start, *twist_path(dome, start, (way_mm[1:] / TORSION_RADIUS_MM).tolist())]
    else:
        stops = [(start.depth_mm, (float(way), 0.0)) for way in way_mm[1:]]
        moved = [start, *press_path(dome, THETA_RAD, stops, kind.probe, start)]
    beads = np.array([beads_mm + sample(pressed.displacement_mm) for pressed in moved])
    slides = [_all_slide(*steps) for steps in pairwise(moved)].index(True)
    load = np.array([_load(pressed, kind) for pressed in moved])
    full = int(np.argmax(load >= FULL * load.max()))
    return SlipPath(way_mm, beads, float(way_mm[slides]), float(way_mm[full]))


def _load(pressed: PressedDome, kind: Kind) -> float:
    """Return the tangential force towards the base, or the torsion, over the normal force."""
    outward, meridional, _ = directions(pressed.theta_rad)
    force = pressed.force_per_mu_mm2
    load = abs(pressed.torsion_per_mu_mm3) if kind.twists else float(force @ meridional)
    return load / float(-force @ outward)


def _all_slide(before: PressedDome, after: PressedDome) -> bool:
    """Return whether every point that touches before and after has slid over the probe."""
    slid = np.linalg.norm(after.state.anchor_mm - before.state.anchor_mm, axis=1)
    return bool((slid[np.isfinite(slid)] > SLIDING_MM).all())


class Fingertip:
    """Contacts of a fingertip from bead places, by the dome model alone."""

    def __init__(self) -> None:
        rings = tuple(Ring(theta, count) for theta, count in LAYOUTS[0])
        self.beads_mm = bead_layout_mm(Markers(BEAD_RADIUS_MM, 3.0, rings))[0]
        self._view = View(CAMERA)
        rest_px = self._view.project(self.beads_mm)
        self._reader = DisplacementReader(rest_px, self._view, BEAD_RADIUS_MM)
        dome = load_dome_model()
        self._model: Regression = _with_torsion(fit(None, dome, RADIUS_MM), dome)

    def contacts(
        self, beads_mm: Array, times_s: Array, random: np.random.Generator, *, twists: bool
    ) -> Iterator[tuple[Contact, MeanMotion]]:
        """Yield contact and mean motion of the beads of each frame; beads_mm (f, n, 3), times_s (f,).

        twists: the contacts have a torsion.
        """
        fields, motions = [], []
        for beads_of_frame in beads_mm:
            place = self._view.project(beads_of_frame)
            place = place + NOISE_PX * random.standard_normal(place.shape)
            beads = Beads.from_positions(place, np.ones(len(place), dtype=bool))
            fields.append(self._reader.read(beads))
            motions.append(self._reader.mean_motion_mm(self._reader.displacement_px(beads)))
        values = np.array([field.values for field in fields])
        directions, forces, _ = self._model.predict(values, np.zeros(len(values)))
        torsions_Nmm = self._model.torsions_Nmm(values) if twists else None
        for number, (field, time_s) in enumerate(zip(fields, times_s, strict=True)):
            turn = rotation_about_z(field.azimuth_rad)
            direction, force_N = turn @ directions[number], SHEAR_MODULUS * turn @ forces[number]
            contact = Contact(
                sequence=number,
                exposed_at_us=round(1e6 * time_s),
                valid=True,
                in_contact=True,
                position_mm=tuple(RADIUS_MM * direction),
                normal_force_N=float(-force_N @ direction),
                force_N=tuple(force_N),
                quality=1.0,
                reason="",
                beads_found=len(beads_mm[0]),
                beads_expected=len(beads_mm[0]),
                torsion_Nmm=None if torsions_Nmm is None else SHEAR_MODULUS * float(torsions_Nmm[number]),
            )
            yield contact, motions[number]


def _with_torsion(model: Regression, dome: DomeModel) -> Regression:
    """Return the model with the torsion of the dome model's twisted presses, by ridge regression."""
    twisted = dome.twisted
    assert twisted is not None
    kernels = gaussian_kernel(model.projection.points(twisted.fields), model.centres, model.length)
    target = twisted.torsions / np.linalg.norm(twisted.fields, axis=1)
    gram = kernels.T @ kernels + TORSION_RIDGE * np.eye(len(model.centres))
    return replace(model, torsion_weights=np.linalg.solve(gram, kernels.T @ target))


def delay_s(
    tip: Fingertip, path: SlipPath, speed_mm_s: float, fps: float, seed: int, *, twists: bool = False
) -> float | None:
    """Return the time of the first frame with a flag after the full load; None without one.

    The probe rests, moves steadily to the end of the path, and rests.
    """
    random = np.random.default_rng(seed)
    full_s = path.full_mm / speed_mm_s
    times_s = (np.arange(round((BEFORE_S + full_s + AFTER_S) * fps)) + random.uniform()) / fps - BEFORE_S
    place = np.interp(times_s * speed_mm_s, path.way_mm, np.arange(len(path.way_mm)))
    low = np.minimum(place.astype(int), len(path.way_mm) - 2)
    share = (place - low)[:, None, None]
    beads_mm = (1.0 - share) * path.beads_mm[low] + share * path.beads_mm[low + 1]
    history: LoadHistory = ()
    frames = tip.contacts(beads_mm, times_s, random, twists=twists)
    for time_s, (contact, skin_mm) in zip(times_s, frames, strict=True):
        history, begins = detect_onset(history, contact, skin_mm)
        if begins:
            return float(time_s - full_s)
    return None


def _row(tip: Fingertip, kind: Kind, path: SlipPath, speed_mm_s: float, fps: float) -> str:
    delays = [delay_s(tip, path, speed_mm_s, fps, seed, twists=kind.twists) for seed in range(SEQUENCES)]
    detected = 1e3 * np.array([one for one in delays if one is not None])
    slides_ms = 1e3 * (path.full_mm - path.slides_mm) / speed_mm_s
    figures = ("", "", "")
    if len(detected):
        median_ms = float(np.median(detected))
        figures = (f"{median_ms:.0f}", f"{detected.max():.0f}", f"{median_ms + slides_ms:.0f}")
    columns = (
        *(kind.name, f"{kind.friction}", f"{path.slides_mm:.2f}", f"{path.full_mm:.2f}"),
        *(f"{speed_mm_s:g}", f"{fps:g}", f"{len(detected)} of {SEQUENCES}", *figures),
    )
    return f"| {' | '.join(columns)} |"


def main() -> None:
    """Print the table, one kind after the other."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument(
        "--paths", type=Path, default=Path(".cache/slip-paths"), help="folder of solved paths"
    )
    options = parser.parse_args()
    options.paths.mkdir(parents=True, exist_ok=True)
    tip = Fingertip()
    print(
        "| kind | friction | all slides mm | full load mm | mm/s | frames/s | detected "
        "| median ms after full load | last ms | median ms after all slides |"
    )
    print("|---|" + 9 * "---:|")
    for kind in KINDS:
        file = options.paths / kind.file_name
        if not file.exists():
            file.write_bytes(pickle.dumps(solve(kind, tip.beads_mm)))
        path: SlipPath = pickle.loads(file.read_bytes())
        for speed_mm_s in SPEEDS_MM_S:
            for fps in FRAME_RATES:
                print(_row(tip, kind, path, speed_mm_s, fps), flush=True)


if __name__ == "__main__":
    main()
