"""Bars over time and their scale."""

from __future__ import annotations

import pytest

from palpate_edge.common.terminal.bar_chart import bar_chart, binned, level_bar, round_scale
from palpate_edge.common.terminal.lines import Palette, plain_text


def test_bins_keep_the_largest_value_of_their_time():
    samples = [(0.0, 9.0), (6.5, 1.0), (7.9, 3.0), (8.5, None), (9.5, 2.0), (10.0, 2.5)]
    assert binned(samples, 10.0, 5.0, 5) == [None, 1.0, 3.0, None, 2.5]


@pytest.mark.parametrize(
    ("most", "scale"), [(0, 1), (1, 1), (1.01, 2), (4, 5), (5.1, 10), (11, 20), (20, 20)]
)
def test_scales_are_round(most, scale):
    assert round_scale(most) == scale


def test_bars_rise_to_their_value():
    values = [None, 0.0, 1.0, 1.5, 2.0]
    rows = [plain_text(line) for line in bar_chart(values, 2, "N", Palette.INDEXED)]
    assert rows == ["    2 N    ▄█", "         ▁███"]
    rows = [plain_text(line) for line in bar_chart(values, 2, "N", Palette.NONE)]
    assert rows == ["    2 N    ##", "         _###"]


def test_a_level_is_cut_at_both_ends():
    bars = [plain_text(level_bar(value, 4.0, 4)) for value in (None, -1.0, 1.0, 9.0)]
    assert bars == ["····", "····", "█···", "████"]
