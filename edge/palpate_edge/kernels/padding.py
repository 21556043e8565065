"""Rows of float32 whose length is a whole number of blocks, as the kernels read them."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Floats

BLOCK = 8
"""Numbers of a block, as in small_matrices.h."""


def padded_length(length: int) -> int:
    """Return the least whole number of blocks that holds `length` numbers."""
    return -(-length // BLOCK) * BLOCK


def padded_rows(values: Array | Floats) -> Floats:
    """Return values (..., n) as float32, the last axis filled up to whole blocks with 0."""
    rows = np.zeros((*values.shape[:-1], padded_length(values.shape[-1])), np.float32)
    rows[..., : values.shape[-1]] = values
    return rows
