"""Matching of a frame's blobs with the beads: all steps of one frame in one call."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array, Indices, Mask
from palpate_edge.kernels.library import POINTER, address, kernel
from palpate_edge.kernels.local_warp import WarpKernel
from palpate_edge.kernels.nearest_blob import BlobGrid


class MatchingLimits(NamedTuple):
    """Limits of vision/correspondence.py, counts of beads and shares; squared_px2 is of a distance."""

    ranking_step: int
    max_hypotheses: int
    max_patches: int
    min_patch: int
    max_rounds: int
    min_support: float
    cap_squared_px2: float
    enough_left: float
    strong: float


class MatchingGates(NamedTuple):
    """Squared distances (n,) of each bead, px^2; see vision/correspondence.py."""

    start: Array
    growth: Array
    near: Array
    smooth: Array
    lattice: Array


class MatchingFields(ctypes.Structure):
    """Mirror of `struct matching`."""

    _fields_ = (
        ("beads", ctypes.c_int32),
        ("neighbours", ctypes.c_int32),
        ("ranking_step", ctypes.c_int32),
        ("max_hypotheses", ctypes.c_int32),
        ("max_patches", ctypes.c_int32),
        ("min_patch", ctypes.c_int32),
        ("max_rounds", ctypes.c_int32),
        ("min_support", ctypes.c_float),
        ("cap_squared", ctypes.c_double),
        ("enough_left", ctypes.c_double),
        ("strong", ctypes.c_double),
        ("reference_px", POINTER),
        ("start_gate", POINTER),
        ("growth_gate", POINTER),
        ("near_squared", POINTER),
        ("smooth_squared", POINTER),
        ("lattice_squared", POINTER),
        ("near", POINTER),
        ("patch_step", POINTER),
        ("grid", POINTER),
        ("strength", POINTER),
        ("warp", POINTER),
        ("hypotheses_px", POINTER),
        ("order", POINTER),
        ("patch", POINTER),
        ("off", POINTER),
        ("label", POINTER),
        ("size", POINTER),
        ("joined", POINTER),
        ("start", POINTER),
        ("blob", POINTER),
        ("last", POINTER),
        ("gate", POINTER),
        ("squared", POINTER),
        ("place_px", POINTER),
        ("taken", POINTER),
        ("best_blob", POINTER),
        ("best_place_px", POINTER),
        ("doubt", ctypes.c_double),
    )


class MatchingKernel:
    """Matches blobs with the n beads of one layout."""

    def __init__(
        self,
        reference_px: Array,
        warp: WarpKernel,
        gates: MatchingGates,
        near: Indices,
        patch_step: Array,
        limits: MatchingLimits,
    ) -> None:
        """reference_px (n, 2): the beads' places; near (n, k): neighbours that may be of a bead's patch, the
        bead's own number instead of those too far away; patch_step (n,): squared difference of displacements,
        px^2, from which on neighbours are of two patches."""
        count, neighbours = near.shape
        self._reference_px, self._warp, self._grid = np.ascontiguousarray(reference_px), warp, BlobGrid()
        self._gates = np.ascontiguousarray(gates)
        self._near, self._patch_step = near.astype(np.int32), patch_step.astype(np.float32)
        self._order, self._patch = (
            np.zeros(limits.max_hypotheses, np.int32),
            np.zeros(limits.max_patches, np.int32),
        )
        self._off, self._joined = np.zeros(limits.max_hypotheses), np.zeros((count, neighbours), np.int32)
        self._numbers = np.zeros((6, count), np.int32)
        self._label, self._best_blob = self._numbers[0], self._numbers[5]
        self._scratch, self._place_px, self._best_place_px = (
            np.zeros((2, count)),
            np.zeros((count, 2)),
            np.zeros((count, 2)),
        )
        self._fields = MatchingFields(
            beads=count,
            neighbours=neighbours,
            ranking_step=limits.ranking_step,
            max_hypotheses=limits.max_hypotheses,
            max_patches=limits.max_patches,
            min_patch=limits.min_patch,
            max_rounds=limits.max_rounds,
            min_support=limits.min_support,
            cap_squared=limits.cap_squared_px2,
            enough_left=limits.enough_left,
            strong=limits.strong,
            reference_px=address(self._reference_px, np.float64),
            near=address(self._near, np.int32),
            patch_step=address(self._patch_step, np.float32),
            grid=ctypes.addressof(self._grid.fields),
            warp=ctypes.addressof(warp.fields),
            order=address(self._order, np.int32),
            patch=address(self._patch, np.int32),
            off=address(self._off, np.float64),
            joined=address(self._joined, np.int32),
            place_px=address(self._place_px, np.float64),
            best_place_px=address(self._best_place_px, np.float64),
        )
        self._point(
            ("start_gate", "growth_gate", "near_squared", "smooth_squared", "lattice_squared"), self._gates
        )
        self._point(("label", "size", "start", "blob", "last", "best_blob"), self._numbers)
        self._point(("gate", "squared"), self._scratch)
        self._reserve(0)
        self._reserve_hypotheses(limits.max_hypotheses)
        self._byref = ctypes.byref(self._fields)
        self._match = kernel("matching_match", POINTER, ctypes.c_int32, ctypes.c_int32)
        self._find_patches = kernel("matching_patches", POINTER)
        self._is_smooth = kernel("matching_is_smooth", POINTER)

    def _point(self, names: tuple[str, ...], rows: NDArray[Any]) -> None:
        """Give the fields of these names one row of an array each."""
        for name, row in zip(names, rows, strict=True):
            setattr(self._fields, name, address(row, rows.dtype.type))

    def _reserve(self, count: int) -> None:
        """Make memory for `count` blobs."""
        self._grid.reserve(count)
        self._strength, self._taken = np.zeros(count), np.zeros(count, np.uint8)
        self._fields.strength = address(self._strength, np.float64)
        self._fields.taken = address(self._taken, np.uint8)

    def _reserve_hypotheses(self, count: int) -> None:
        """Make memory for `count` hypotheses."""
        self._hypotheses_px = np.zeros((count, *self._reference_px.shape))
        self._fields.hypotheses_px = address(self._hypotheses_px, np.float64)

    def match(
        self, blob_px: Array, strength: Array, hypotheses_px: Array | Sequence[Array]
    ) -> tuple[Indices, Array, float]:
        """Return each bead's blob (n,), or NO_BLOB, its place (n, 2) as its neighbours predict it, and the
        doubt.

        blob_px (m, 2), strength (m,): blobs; hypotheses_px (h, n, 2): where the beads may be, at least one.
        """
        count, hypotheses = len(strength), len(hypotheses_px)
        if count > len(self._strength):
            self._reserve(count)
        if hypotheses > len(self._hypotheses_px):
            self._reserve_hypotheses(hypotheses)
        for own, hypothesis_px in zip(self._hypotheses_px, hypotheses_px, strict=False):
            np.copyto(own, hypothesis_px)
        np.copyto(self._grid.blob_px[:count], blob_px)
        np.copyto(self._strength[:count], strength)
        self._match(self._byref, count, hypotheses)
        return self._best_blob.astype(np.intp), self._best_place_px.copy(), self._fields.doubt

    def patches(self, displacement_px: Array, known: Mask) -> list[Mask]:
        """Return the patches (n,) of the known beads, the largest first."""
        np.copyto(self._warp.displacement_px, displacement_px)
        np.copyto(self._warp.known, known)
        labels = self._patch[: self._find_patches(self._byref)]
        return [(self._label == label) & known for label in labels]

    def is_smooth(self, position_px: Array, found: Mask) -> bool:
        """Return whether each found bead at position_px (n, 2) is displaced as its neighbours predict."""
        np.subtract(position_px, self._reference_px, out=self._warp.displacement_px)
        np.copyto(self._warp.known, found)
        return bool(self._is_smooth(self._byref))
