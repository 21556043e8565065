"""Beads of an unknown sensor: which blobs of one image are beads, on which channel, and how large they are.

Every channel, dark and bright beads, and several diameters are tried on a reduced image. Blobs that are
round and isolated (:mod:`palpate_edge.vision.disk_profile`), and spaced like those around them, are beads if
they are most of what stands out. The channel and the diameter that show most of them, and most clearly, are
taken. Then all of the image's beads are collected on that channel, smaller and larger ones too. An image
without such blobs has no beads.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Image, Indices, Mask, Plane
from palpate_edge.geometry.points import distances
from palpate_edge.vision.appearance import GREY_PREFERENCE, Appearance, appearances, plane, unlit_grey
from palpate_edge.vision.blob_detection import MIN_STRENGTH, Blobs, find_blobs, strongest_other
from palpate_edge.vision.disk_profile import DiskProfile, disk_profile

HEIGHT_OVER_DIAMETER = (80, 64, 50, 40, 32, 25, 20, 16)  # of the image; tried without a diameter
SEARCH_HEIGHT = 320  # pixels; higher images are reduced for the search
MIN_DIAMETER_PX = 4.0
MIN_BEADS = 6
MAX_CANDIDATES = 800
MIN_CONTRAST = 8.0  # grey levels
MIN_CONTRAST_SHARE = 0.35  # of the median contrast of undisturbed beads
MIN_PURITY = 0.4  # share of undisturbed beads in the blobs that stand out half as much as they
TOLERANCE = 1.5  # of the disk's limits, for beads of uneven light beside undisturbed ones
SIZE_FACTORS = (0.65, 0.8, 1.0, 1.25, 1.5)  # of the diameter: a wide lens shows near beads larger
SPACING_RANGE = (0.55, 2.0)  # distance to the nearest bead, over that of the beads around
SIZE_RANGE = (0.6, 1.6)  # diameter, over that of the beads around
NEIGHBOURS = 12  # beads around, whose spacing and diameter are compared
ABOUT_AS_MANY = 0.9  # of the most beads that a channel shows; among such channels the clearest is taken
REFLECTION = 0.6  # of the largest of these channels' diameters; smaller are lamps reflected by the beads
CLEAR = 5.0  # times the strongest other spot; more makes a channel no better
SATURATED = 250.0  # grey level of a reflection of a lamp
MAX_SATURATED_SHARE = 1 / 3  # of bright beads; above it the beads themselves are overexposed

SHAPE = ("contrast", "diameter", "oval", "isolation", "offset", "filled")

Selection = Callable[[Array], Mask]  # places (n, 2) -> which may hold a bead


class _Candidates(msgspec.Struct, frozen=True):
    """Blobs of one plane at one diameter, with their shape."""

    position_px: Array
    strength: Array
    profile: DiskProfile
    diameter_px: Array
    saturated: Mask

    def chosen(self, which: Mask | Indices) -> _Candidates:
        """Return some of the candidates."""
        return _Candidates(
            self.position_px[which],
            self.strength[which],
            DiskProfile(*(getattr(self.profile, name)[which] for name in SHAPE)),
            self.diameter_px[which],
            self.saturated[which],
        )


def everywhere(position_px: Array) -> Mask:
    """Return that a bead may be anywhere."""
    return np.ones(len(position_px), dtype=np.bool_)


def beads_without_layout(
    image: Image, diameter_px: float | None = None, may_hold: Selection = everywhere
) -> tuple[Blobs, Appearance, float]:
    """Return the beads of an unknown layout, their appearance, and their median diameter in pixels.

    Without `diameter_px`, diameters from 1/80 to 1/16 of the image's height are tried. may_hold: places where
    a bead can be. An image without beads gives no blobs.
    """
    scale = min(1.0, SEARCH_HEIGHT / image.shape[0])
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    reduced = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    wanted = [diameter_px] if diameter_px else [image.shape[0] / n for n in HEIGHT_OVER_DIAMETER]
    sizes = [scale * one for one in wanted if scale * one >= MIN_DIAMETER_PX or diameter_px]
    sizes = [one for one in sizes if one * SIZE_FACTORS[-1] < min(reduced.shape[:2])]
    tried = [
        _best_diameter(reduced, appearance, sizes, lambda places: may_hold(places / scale))
        for appearance in appearances(image)
    ]
    most = max(trial.count for trial in tried)
    if not most:
        none = Blobs(np.zeros((0, 2)), np.zeros(0))
        return none, Appearance(), diameter_px or image.shape[0] / HEIGHT_OVER_DIAMETER[0]
    tried = [trial for trial in tried if trial.count >= ABOUT_AS_MANY * most]
    largest_px = max(trial.diameter_px for trial in tried)
    best = max((trial for trial in tried if trial.diameter_px > REFLECTION * largest_px), key=_clearness)
    size_px = best.diameter_px / scale
    beads = _collect(plane(image, best.appearance), best.appearance, size_px, may_hold)
    return beads, best.appearance, size_px


class _Trial(msgspec.Struct, frozen=True):
    """Beads of one channel at one diameter.

    count: their number times purity; strength: median; other_strength: of the strongest other blob;
    diameter_px: median.
    """

    appearance: Appearance
    count: float = 0.0
    strength: float = 0.0
    other_strength: float = MIN_STRENGTH
    diameter_px: float = 0.0


def _best_diameter(
    image: Image, appearance: Appearance, sizes_px: list[float], may_hold: Selection
) -> _Trial:
    """Return the trial with the diameter that shows most beads."""
    best, dark = _Trial(appearance), plane(image, appearance)
    for size_px in sizes_px:
        found = _candidates(dark, appearance, size_px, may_hold)
        beads, purity = _beads(found)
        if len(beads) * purity > best.count:
            strength, diameter_px = (
                float(np.median(of[beads])) for of in (found.strength, found.diameter_px)
            )
            others = strongest_other(found.strength, beads)
            best = _Trial(appearance, len(beads) * purity, strength, others, diameter_px)
    return best


def _clearness(trial: _Trial) -> float:
    """Return how far the beads stand out from the strongest other blob, up to `CLEAR`.

    Patches of light are blobs on grey, and none on a difference of colours.
    """
    clearness = min(CLEAR, trial.strength / trial.other_strength)
    return clearness * (GREY_PREFERENCE if trial.appearance.channel == "grey" else 1.0)


def _candidates(dark: Plane, appearance: Appearance, diameter_px: float, may_hold: Selection) -> _Candidates:
    """Return the strongest blobs of a plane where beads may be."""
    blobs = find_blobs(dark, diameter_px)
    place, strength = blobs.position_px[:MAX_CANDIDATES], blobs.strength[:MAX_CANDIDATES]
    inside = may_hold(place)
    place, strength = place[inside], strength[inside]
    profile = disk_profile(dark, place, diameter_px)
    saturated = np.zeros(len(place), dtype=np.bool_)
    unlit = unlit_grey(appearance)
    if appearance.bright and unlit is not None:
        column, row = place.T.astype(np.intp)
        saturated = cv2.erode(dark, np.ones((3, 3), np.uint8))[row, column] <= unlit - SATURATED
    return _Candidates(place, strength, profile, profile.diameter * diameter_px, saturated)


def _beads(found: _Candidates) -> tuple[Indices, float]:
    """Return the indices of the beads, and their purity: the share of undisturbed ones in what stands out."""
    none = np.zeros(0, dtype=np.intp)
    clear = _undisturbed(found)
    if clear.sum() < MIN_BEADS:
        return none, 0.0
    limits = _limits(found, clear)
    clear &= limits.allows(found)
    strong = found.strength > 0.5 * float(np.median(found.strength[clear]))
    strong &= ~(found.saturated & limits.lamps)
    purity = float((strong & clear).sum() / max(1, strong.sum()))
    beads = _evenly_spaced(found, found.profile.is_disk(TOLERANCE) & limits.allows(found))
    enough = clear.sum() >= MIN_BEADS and purity >= MIN_PURITY and len(beads) >= MIN_BEADS
    return (beads, purity) if enough else (none, 0.0)


def _undisturbed(found: _Candidates) -> Mask:
    """Return which blobs are disks by the strict limits."""
    return np.asarray(found.profile.is_disk() & (found.profile.contrast > MIN_CONTRAST))


class _Limits(msgspec.Struct, frozen=True):
    """Limits shared by the beads of one picture: a least contrast; lamps: saturated blobs are reflections."""

    least_contrast: float
    lamps: bool

    def allows(self, found: _Candidates) -> Mask:
        return np.asarray((found.profile.contrast > self.least_contrast) & ~(found.saturated & self.lamps))


def _limits(found: _Candidates, clear: Mask) -> _Limits:
    """Return the limits that the undisturbed beads (n,), at least one, set for all others."""
    contrast = float(np.median(found.profile.contrast[clear]))
    lamps = bool(found.saturated[clear].mean() < MAX_SATURATED_SHARE)
    return _Limits(max(MIN_CONTRAST, MIN_CONTRAST_SHARE * contrast), lamps)


def _collect(dark: Plane, appearance: Appearance, diameter_px: float, may_hold: Selection) -> Blobs:
    """Return all beads of a plane, of about `diameter_px` or somewhat smaller or larger, strongest first."""
    main = _candidates(dark, appearance, diameter_px, may_hold)
    clear = _undisturbed(main)
    limits = _limits(main, clear if clear.any() else np.ones_like(clear))
    parts = []
    for factor in SIZE_FACTORS:
        found = _candidates(dark, appearance, factor * diameter_px, may_hold)
        parts.append(found.chosen(found.profile.is_disk(TOLERANCE) & limits.allows(found)))
    everything = _joined(parts)
    fault = everything.profile.oval + everything.profile.offset
    once = everything.chosen(_least_faulty(everything.position_px, fault, everything.diameter_px))
    kept = _evenly_spaced(once, np.ones(len(once.strength), dtype=np.bool_))
    kept = kept[np.argsort(-once.strength[kept], kind="stable")]
    return Blobs(once.position_px[kept], once.strength[kept])


def _joined(parts: list[_Candidates]) -> _Candidates:
    """Return the candidates of all parts as one."""
    profiles = [part.profile for part in parts]
    return _Candidates(
        np.concatenate([part.position_px for part in parts]),
        np.concatenate([part.strength for part in parts]),
        DiskProfile(*(np.concatenate([getattr(one, name) for one in profiles]) for name in SHAPE)),
        np.concatenate([part.diameter_px for part in parts]),
        np.concatenate([part.saturated for part in parts]),
    )


def _least_faulty(place_px: Array, fault: Array, diameter_px: Array) -> Indices:
    """Return the indices of the blobs of least fault among those that lie on one bead."""
    kept: list[int] = []
    for index in np.argsort(fault, kind="stable").tolist():
        apart = np.linalg.norm(place_px[kept] - place_px[index], axis=1)
        if not (apart < 0.5 * (diameter_px[kept] + diameter_px[index])).any():
            kept.append(index)
    return np.array(sorted(kept), dtype=np.intp)


def _evenly_spaced(found: _Candidates, among: Mask) -> Indices:
    """Return the indices of those `among` the blobs that are spaced and sized like the ones around them.

    Of two that are too near to each other, the one goes whose contrast and size differ more from the others'.
    """
    kept = np.flatnonzero(among)
    contrast, size = (np.log(np.maximum(v, 1e-3)) for v in (found.profile.contrast, found.diameter_px))
    while len(kept) >= MIN_BEADS:
        apart = distances(found.position_px[kept], found.position_px[kept])
        np.fill_diagonal(apart, np.inf)
        nearest = apart.min(axis=1)
        around = np.argsort(apart, axis=1)[:, :NEIGHBOURS]
        typical = np.median(nearest[around], axis=1)
        odd = sum(np.abs(value[kept] - np.median(value[kept])) for value in (contrast, size))
        low, high = SPACING_RANGE
        crowded = (nearest < low * typical) & (odd >= odd[apart.argmin(axis=1)])
        relative = found.diameter_px[kept] / np.median(found.diameter_px[kept][around], axis=1)
        wrong = crowded | (nearest > high * typical)
        wrong |= (relative < SIZE_RANGE[0]) | (relative > SIZE_RANGE[1])
        if not wrong.any():
            return kept
        kept = kept[~wrong]
    return np.zeros(0, dtype=np.intp)
