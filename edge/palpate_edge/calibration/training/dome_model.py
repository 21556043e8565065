"""The pre-trained dome: presses of simulated or other sensors, in the canonical frame.

Because canonical fields do not depend on where the beads are, presses of one dome teach about another.
Forces are those of a silicone of shear modulus 1 N/mm^2 (or of the sensor they came from): their scale is
fitted to the sensor at hand, the rest is learned from its own presses as a difference.
"""

from __future__ import annotations

import zipfile
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Mask
from palpate_edge.common.atomic_write import atomic_file
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.displacement_field import canonical_directions, mirrored

SHIPPED = Path(__file__).with_name("dome.npz")
NAMES = ("fields", "directions", "forces", "markers_radius_mm")
# A file may have none of these two groups.
TWISTED_NAMES = ("twisted_fields", "torsions")  # of presses whose torsion is known
SOLID_NAMES = ("points", "modes", "amounts", "solid_directions", "solid_forces", "solid_torsions")
FIELDS = ("fields", "twisted_fields")
PAIRED = "paired"  # in a file that leaves out the mirror images, each of which follows its press
MIRROR = np.array([1.0, -1.0, 1.0])
MODES = 120  # principal motions that a file keeps: 0.1 % of a press's motion is left
# What numpy, zipfile and zlib raise on a file that is none, or whose bytes were changed.
DAMAGED = (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True, slots=True)
class TwistedPresses:
    """m presses of known torsion: fields (m, 2 g) mm in the canonical frame, torsions (m,) about the inward
    normal."""

    fields: Array
    torsions: Array


@dataclass(frozen=True, slots=True)
class SolidPresses:
    """s presses in three dimensions, not yet seen by a camera: motions (s, d, 3) mm of the beads' sphere at
    the unit vectors points (d, 3), directions (s, 3) of contact, at azimuth 0, forces (s, 3), and torsions
    (s,) about the inward normal."""

    points: Array
    motions: Array
    directions: Array
    forces: Array
    torsions: Array

    def every(self, step: int) -> SolidPresses:
        """Return one of `step` presses, in their order."""
        return SolidPresses(
            self.points,
            self.motions[::step],
            self.directions[::step],
            self.forces[::step],
            self.torsions[::step],
        )


@dataclass(frozen=True, slots=True)
class DomeModel:
    """n presses: fields (n, 2 g) mm, directions (n, 3) of contact, forces (n, 3), all in the canonical
    frame, of a dome whose beads lie on a sphere of markers_radius_mm. twisted: presses that teach the
    torsion, None where none is known. solid: further presses for `seen_presses`, None without them. plain
    (n,): those that are neither turned nor have hidden beads, None where none is. is_seen: whether the n
    presses are as the camera of the sensor at hand shows them."""

    fields: Array
    directions: Array
    forces: Array
    markers_radius_mm: float
    twisted: TwistedPresses | None = None
    solid: SolidPresses | None = None
    plain: Mask | None = None
    is_seen: bool = False

    def for_markers(self, radius_mm: float) -> DomeModel:
        """The same dome in another size: motions grow with it, forces with its square, torsions with its
        cube."""
        ratio = radius_mm / self.markers_radius_mm
        twisted = self.twisted
        if twisted is not None:
            twisted = TwistedPresses(twisted.fields * ratio, twisted.torsions * ratio**3)
        solid = self.solid
        if solid is not None:
            solid = replace(
                solid,
                motions=solid.motions * ratio,
                forces=solid.forces * ratio**2,
                torsions=solid.torsions * ratio**3,
            )
        return replace(
            self,
            fields=self.fields * ratio,
            forces=self.forces * ratio**2,
            markers_radius_mm=radius_mm,
            twisted=twisted,
            solid=solid,
        )


def load_dome_model(path: Path = SHIPPED) -> DomeModel:
    """Read a dome model; what else the file holds is left out. Raises CalibrationError naming the file and
    the way out."""
    try:
        with path.open("rb") as opened, NpzFile(opened, allow_pickle=False) as file:
            if "kind" in file:
                raise CalibrationError(
                    f"{path} is a pose model, a press dataset needs a dome model: make one with "
                    "palpate-edge train from press datasets"
                )
            groups = [group for group in (TWISTED_NAMES, SOLID_NAMES) if any(name in file for name in group)]
            names = sum(groups, NAMES)
            arrays = {name: np.asarray(file[name], dtype=np.float64) for name in names}
            is_paired = PAIRED in file
    except FileNotFoundError:
        raise CalibrationError(f"{path} is missing: make it with palpate-edge train") from None
    except DAMAGED as error:
        raise CalibrationError(
            f"{path} is no dome model ({error}): make it with palpate-edge train"
        ) from None
    _check(arrays, path)
    if is_paired:
        _add_images(arrays)
    twisted = [arrays[name] for name in TWISTED_NAMES if name in arrays]
    return DomeModel(
        arrays["fields"],
        arrays["directions"],
        arrays["forces"],
        float(arrays["markers_radius_mm"]),
        TwistedPresses(*twisted) if twisted else None,
        _solid_presses(arrays),
    )


def _images(arrays: dict[str, Array]) -> dict[str, Array]:
    """Return the mirror images of the presses (y -> -y), those in three dimensions left out."""
    images: dict[str, Array] = {name: mirrored(arrays[name]) for name in FIELDS if name in arrays}
    images |= {name: np.asarray(arrays[name] * MIRROR) for name in ("directions", "forces")}
    if "torsions" in arrays:
        images["torsions"] = -arrays["torsions"]
    return images


def _add_images(arrays: dict[str, Array]) -> None:
    """Put the mirror image of each press behind it."""
    for name, images in _images(arrays).items():
        both = np.stack([arrays[name], images], axis=1)
        arrays[name] = both.reshape(-1, *images.shape[1:])


def _solid_presses(arrays: dict[str, Array]) -> SolidPresses | None:
    """Return a file's presses in three dimensions, None if it has none."""
    if "points" not in arrays:
        return None
    motions = np.tensordot(arrays["amounts"], arrays["modes"], 1)
    return SolidPresses(
        arrays["points"],
        motions,
        arrays["solid_directions"],
        arrays["solid_forces"],
        arrays["solid_torsions"],
    )


def _principal_motions(motions: Array) -> tuple[Array, Array]:
    """Return at most `MODES` modes (k, d, 3) and the amounts (s, k) of them in motions (s, d, 3), none of
    which is zero. Each press counts alike, however light."""
    rows = motions.reshape(len(motions), -1)
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    shapes, spread, modes = np.linalg.svd(rows / size, full_matrices=False)
    amounts = size * shapes[:, :MODES] * spread[:MODES]
    return modes[:MODES].reshape(-1, *motions.shape[1:]), amounts


def _check(arrays: dict[str, Array], path: Path) -> None:
    """Refuse what a readable file can still have wrong."""
    count, width = arrays["forces"].size // 3, 2 * len(canonical_directions())
    shapes: dict[str, tuple[int, ...]] = {
        "fields": (count, width),
        "directions": (count, 3),
        "forces": (count, 3),
        "markers_radius_mm": (),
    }
    if "torsions" in arrays:
        shapes |= {
            "twisted_fields": (arrays["torsions"].size, width),
            "torsions": (arrays["torsions"].size,),
        }
    if "points" in arrays:
        points, presses = arrays["points"].size // 3, arrays["solid_forces"].size // 3
        modes = arrays["modes"].size // max(1, 3 * points)
        shapes |= {
            "points": (points, 3),
            "modes": (modes, points, 3),
            "amounts": (presses, modes),
            "solid_directions": (presses, 3),
            "solid_forces": (presses, 3),
            "solid_torsions": (presses,),
        }
    if any(array.shape != shapes[name] for name, array in arrays.items()):
        raise CalibrationError(f"{path} is of another version: make it again with palpate-edge train")
    whole = all(np.isfinite(array).all() for array in arrays.values())
    if not (count and whole and arrays["markers_radius_mm"] > 0):
        raise CalibrationError(
            f"{path} contains no presses, or NaN or infinite values: make it again with palpate-edge train"
        )


def save_dome_model(dome: DomeModel, path: Path) -> None:
    """Write a dome model, fields in half precision (0.1 % of a motion)."""
    presses: dict[str, Array] = {"fields": dome.fields, "directions": dome.directions, "forces": dome.forces}
    if dome.twisted is not None:
        presses |= {"twisted_fields": dome.twisted.fields, "torsions": dome.twisted.torsions}
    firsts = {name: values[::2] for name, values in presses.items()}
    is_paired = all(np.array_equal(images, presses[name][1::2]) for name, images in _images(firsts).items())
    arrays: dict[str, NDArray[np.generic]] = {"markers_radius_mm": np.asarray(dome.markers_radius_mm)}
    for name, values in (firsts if is_paired else presses).items():
        arrays[name] = values.astype(np.float16 if name in FIELDS else np.float32)
    if is_paired:
        arrays[PAIRED] = np.asarray(is_paired)
    if dome.solid is not None:
        arrays["points"] = dome.solid.points.astype(np.float32)
        modes, amounts = _principal_motions(dome.solid.motions)
        arrays["modes"], arrays["amounts"] = modes.astype(np.float16), amounts.astype(np.float16)
        arrays["solid_directions"] = dome.solid.directions.astype(np.float32)
        arrays["solid_forces"] = dome.solid.forces.astype(np.float32)
        arrays["solid_torsions"] = dome.solid.torsions.astype(np.float32)
    with atomic_file(path, CalibrationError) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays)
