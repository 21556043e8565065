"""Padded rows: whole blocks of the length that the C code has."""

from __future__ import annotations

import re

import numpy as np

from palpate_edge.kernels.library import FOLDER
from palpate_edge.kernels.padding import BLOCK, padded_length, padded_rows


def test_the_block_is_that_of_the_c_code():
    header = (FOLDER / "small_matrices.h").read_text()
    assert re.findall(r"#define BLOCK (\d+)", header) == [str(BLOCK)]


def test_rows_are_filled_up_with_zeros():
    assert [padded_length(count) for count in (0, 1, BLOCK, BLOCK + 1)] == [0, BLOCK, BLOCK, 2 * BLOCK]
    rows = padded_rows(np.ones((2, 3, BLOCK + 1)))
    assert rows.shape == (2, 3, 2 * BLOCK)
    assert rows.dtype == np.float32
    assert (rows.sum(axis=2) == BLOCK + 1).all()
