"""Training samples: presses in the canonical frame, each several times, turned and with beads hidden."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.measurement import Measured
from palpate_edge.calibration.training.dome_adjustment import JigPress
from palpate_edge.calibration.training.dome_model import MIRROR
from palpate_edge.common.arrays import Array, Mask
from palpate_edge.estimation.displacement_field import DisplacementReader, mirrored
from palpate_edge.estimation.skin_motion import SkinMotion, faintness
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.vision.beads import Beads

TURN_SIGMA_RAD = 0.15  # a shear or noise turns the motion's centre of gravity by about this much
MAX_HIDDEN = 0.3
REGION_SHARE = 0.25  # of the copies of a sensor's own presses: the radius is then right for hidden regions
FAR_COSINE = math.cos(math.radians(40.0))  # between the contact and each bead of such a region
MOST_SAMPLES = 2000
MOST_COPIES = 8


@dataclass(frozen=True, slots=True)
class TrainingPress:
    """A press as tracked: its beads, where it touched (unit vector (3,) in F), its force (3,) N in F (None
    where it was not measured), its motion.faintness, and its torsion about the inward normal (None where it
    was not measured)."""

    beads: Beads
    direction: Array
    force_N: Array | None
    faintness: float = 1.0
    torsion_Nmm: float | None = None


@dataclass(frozen=True, slots=True)
class Samples:
    """s samples: fields (s, 2 g) mm, directions (s, 3), forces_N (s, 3) in the canonical frame, hidden (s,)
    blind spots, faintness (s,), press (s,) index of the press each comes from, plain (s,): neither turned nor
    hidden. forces_N are 0 throughout where no force was measured, torsions_Nmm (s,) are None then."""

    fields: Array
    directions: Array
    forces_N: Array
    hidden: Array
    faintness: Array
    press: NDArray[np.intp]
    plain: NDArray[np.bool_]
    torsions_Nmm: Array | None = None

    @property
    def has_forces(self) -> bool:
        """Return whether the presses' forces are known."""
        return bool(self.forces_N.any())


@dataclass(frozen=True, slots=True)
class WeighedSamples:
    """Fields (w, 2 g) mm of weighed presses in the canonical frame, and their normal forces (w,) N."""

    fields: Array
    normal_N: Array


def training_presses(measured: Measured) -> list[TrainingPress]:
    """The touches of a dataset as training presses; weighed ones are left out."""
    skin, presses = SkinMotion(measured.reference), []
    for press, beads in measured.touches:
        if press.position_mm is None or press.is_weighed:
            continue
        presses.append(
            TrainingPress(
                beads,
                np.array(press.position_mm) / np.linalg.norm(press.position_mm),
                None if press.force_N is None else np.array(press.force_N),
                _faintness(skin, beads, measured.threshold_px),
                press.torsion_Nmm,
            )
        )
    return presses


def jig_presses(measured: Measured) -> list[JigPress]:
    """Return the weighed presses of known place."""
    skin = SkinMotion(measured.reference)
    return [
        JigPress(
            beads,
            np.array(press.position_mm) / np.linalg.norm(press.position_mm),
            _faintness(skin, beads, measured.threshold_px),
        )
        for press, beads in measured.touches
        if press.position_mm is not None and press.is_weighed
    ]


def _faintness(skin: SkinMotion, beads: Beads, threshold_px: float) -> float:
    moved = skin.measure(beads)
    return faintness(moved.size_px / moved.noise, threshold_px)


def weighed_samples(measured: Measured, reader: DisplacementReader) -> WeighedSamples | None:
    """Return the weighed presses of a dataset; None where it has none."""
    weighed = [(press, beads) for press, beads in measured.touches if press.is_weighed]
    if not weighed:
        return None
    fields = np.array([reader.read(beads).values for _, beads in weighed])
    return WeighedSamples(fields, np.array([press.normal_force_N for press, _ in weighed]))


def make_samples(
    reader: DisplacementReader,
    presses: Sequence[TrainingPress],
    seed: int = 0,
    copies: int | None = None,
    *,
    varied: Mask | None = None,
    region_share: float = 0.0,
) -> Samples:
    """Every press in turned, partly hidden copies, the first as it is; each with its mirror image.

    copies: as many as `MOST_SAMPLES` and `MOST_COPIES` allow when not given; varied: of which presses (n,) no
    copy is as it is, of none when not given; region_share: of the copies that hide a region.
    """
    rng, (unit, _) = np.random.default_rng(seed), reader.geometry
    if copies is None:
        copies = int(np.clip(MOST_SAMPLES // max(1, 2 * len(presses)), 1, MOST_COPIES))
    fields, directions, forces, hidden, faint, owner, plain = [], [], [], [], [], [], []
    torsions: list[float] = []
    for index, press in enumerate(presses):
        is_varied = varied is not None and bool(varied[index])
        for copy in range(copies):
            beads, turn = press.beads, 0.0
            if copy or is_varied:
                beads = _hide(press.beads, unit, press.direction, rng, region_share)
                turn = float(TURN_SIGMA_RAD * rng.standard_normal())
            field = reader.read(beads, turn)
            to_canonical = rotation_about_z(field.azimuth_rad).T
            direction = to_canonical @ press.direction
            force = np.zeros(3) if press.force_N is None else to_canonical @ press.force_N
            for values, sign in ((field.values, np.ones(3)), (mirrored(field.values), MIRROR)):
                fields.append(values)
                directions.append(direction * sign)
                forces.append(force * sign)
                hidden.append(field.hidden)
                faint.append(press.faintness)
                owner.append(index)
                plain.append(copy == 0 and not is_varied)
                torsions.append(float(sign[1]) * (press.torsion_Nmm or 0.0))
    return Samples(
        np.array(fields),
        np.array(directions),
        np.array(forces),
        np.array(hidden),
        np.array(faint),
        np.array(owner, dtype=np.intp),
        np.array(plain, dtype=np.bool_),
        None if any(press.torsion_Nmm is None for press in presses) else np.array(torsions),
    )


def _hide(
    beads: Beads, unit: Array, direction: Array, rng: np.random.Generator, region_share: float
) -> Beads:
    """The same beads with up to `MAX_HIDDEN` of them not found: any ones or, with a probability of
    `region_share`, neighbours that are not at the contact.

    unit (n, 3), direction (3,): of the beads and the contact, from the dome's centre.
    """
    count = len(beads.found)
    lost = rng.permutation(count)[: int(rng.uniform(0.0, MAX_HIDDEN) * count)]
    if len(lost) and rng.uniform() < region_share:
        region = np.argsort(-(unit @ unit[lost[0]]))[: len(lost)]
        if (unit[region] @ direction).max() < FAR_COSINE:
            lost = region
    found = beads.found.copy()
    found[lost] = False
    return Beads.from_positions(beads.position_px, found)
