"""Choice of how a sensor's bead places are measured: by centroids, or by symmetry on which channels,
in which light.

Which is best depends on beads, skin and light: white light that changes displaces bright balls on grey but
not by colour, haze and compression leave little of the colour, and a centroid is exact and cheap where light
is even. Therefore each way is tried on frames without contact, where no bead moves, and the one whose places
vary least is taken. Reference frames may be better pictures than the presses' frames. Where only they are
without contact, a press's beads count as well, by how far they lie from where their neighbours predict them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.vision.appearance import Appearance
from palpate_edge.vision.beads import EVEN_LIGHT, GREY_FIT, SLOPED_LIGHT, Beads, Reference
from palpate_edge.vision.local_warp import LocalWarp
from palpate_edge.vision.symmetric_fit import FIT_CHANNELS, SymmetricFit
from palpate_edge.vision.tracker import Tracker

BETTER, FIT_BETTER = (
    0.8,
    0.95,
)  # of the variation: a fit has to vary less than centroids, or than a fit before
MAX_OFF = 0.1  # of a bead diameter; a place farther off counts as that far


def choose_fit(
    reference: Reference,
    appearance: Appearance,
    references: Sequence[Image],
    untouched: Sequence[Image],
    others: Sequence[Image] = (),
) -> Reference:
    """Return the reference with the channels on which its beads are measured best, or with none.

    references: images of the reference frames; untouched: frames without contact; others: frames of any kind,
    which count as well.
    """
    grey = appearance.channel == "grey"
    ways = [reference] if grey else []
    for channels in (GREY_FIT,) if grey else FIT_CHANNELS:
        for light in (SLOPED_LIGHT, EVEN_LIGHT):
            way = replace(reference, fit_channels=channels, fit_light=light)
            ways.append(replace(way, fit_sigma_px=_sigma_px(way, references)))
    still, rest = (
        _found_by_all([_follow(way, appearance, images) for way in ways]) for images in (untouched, others)
    )
    off = [_variation(reference, frames) for frames in still]
    if others:  # both are errors, of light and of noise, and none is in the other's measure
        off = [
            math.sqrt(each * _roughness(reference, frames)) for each, frames in zip(off, rest, strict=True)
        ]
    best = 0
    for number in range(1, len(ways)):
        if off[number] < (BETTER if ways[best].fit_sigma_px is None else FIT_BETTER) * off[best]:
            best = number
    return ways[best]


def _follow(reference: Reference, appearance: Appearance, images: Sequence[Image]) -> list[Beads]:
    """Return the beads of single frames."""
    tracker = Tracker(reference)
    frames = []
    for image in images:
        tracker.reset()
        frames.append(tracker.follow_image(image, appearance))
    return frames


def _found_by_all(ways: Sequence[Sequence[Beads]]) -> list[list[Beads]]:
    """Return the frames of each way with those beads as found that all ways found."""
    return [
        [
            msgspec.structs.replace(beads, found=np.logical_and.reduce([way[number].found for way in ways]))
            for number, beads in enumerate(frames)
        ]
        for frames in ways
    ]


def _variation(reference: Reference, frames: Sequence[Beads]) -> float:
    """Return the deviation of found beads from their median places, in bead diameters: that of a mean over
    all places in which each counts by its noise, times the root of their number."""
    off = np.linalg.norm(_places(frames) - _median_places(frames), axis=2) / reference.diameter_px
    weight = np.array([beads.weight for beads in frames]).reshape(off.shape)
    seen = np.isfinite(off)
    if not seen.any():
        return 0.0
    weighted = weight[seen] * np.minimum(off[seen], MAX_OFF)
    return float(np.sqrt(seen.sum()) * np.linalg.norm(weighted) / weight[seen].sum())


def _roughness(reference: Reference, frames: Sequence[Beads]) -> float:
    """Return the median distance of found beads from their neighbours' prediction, in bead diameters."""
    warp, off = LocalWarp(reference.neighbourhood), [np.zeros(0)]
    for beads in frames:
        moved_px = beads.position_px - reference.position_px
        predicted_px, _ = warp.predict(moved_px, beads.found)
        apart_px = np.linalg.norm(moved_px - predicted_px, axis=1)
        off.append((apart_px / reference.diameter_px)[beads.found])
    every = np.concatenate(off)
    return float(np.median(every)) if len(every) else 0.0


def _places(frames: Sequence[Beads]) -> Array:
    """Return the places (frames, n, 2) of the beads, nan where they were not found."""
    return np.array([np.where(beads.found[:, None], beads.position_px, np.nan) for beads in frames])


def _median_places(frames: Sequence[Beads]) -> Array:
    """Return the median places (n, 2), nan where no frame shows the bead."""
    places = _places(frames)
    median = np.full(places.shape[1:], np.nan)
    seen = np.isfinite(places).any(axis=(0, 2))
    median[seen] = np.nanmedian(places[:, seen], axis=0)
    return median


def _sigma_px(reference: Reference, images: Sequence[Image]) -> float:
    """Return the median over beads and frames of the symmetric fit's standard deviation, px."""
    fit = SymmetricFit(
        reference.diameter_px,
        reference.neighbourhood.spacing_px,
        reference.fit_channels,
        reference.fit_light,
    )
    every = np.arange(len(reference.diameter_px))
    sigma_px = []
    for image in images:
        fit.load(image)
        sigma_px.append(fit.measure(reference.position_px, every).sigma_px)
    return float(np.median(sigma_px))
