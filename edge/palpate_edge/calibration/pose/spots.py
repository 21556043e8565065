"""Spots of every press of a pose dataset."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from palpate_edge.calibration.pose.rest_markers import RestMarkers
from palpate_edge.datasets.pose_dataset import PoseDataset, PosePress
from palpate_edge.estimation.pose.spot_detection import SpotDetector
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.blob_detection import Blobs


def press_spots(
    dataset: PoseDataset,
    presses: Sequence[PosePress],
    rest: RestMarkers,
    progress: Callable[[int], None] = lambda _done: None,
) -> list[Blobs]:
    """Return the spots of each press; `progress` counts presses."""
    detector = SpotDetector(rest.diameter_px, rest.weakest_strength, len(rest.position_px))
    grey = rest.appearance.channel == "grey"
    spots = []
    for number, press in enumerate(presses, start=1):
        image = dataset.read(dataset.path(press), grey=grey)
        spots.append(detector.find(plane(image, rest.appearance)))
        progress(number)
    return spots
