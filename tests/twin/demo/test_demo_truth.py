"""Contacts of a hand-made log against a hand-made truth; expected figures are computed by hand."""

from __future__ import annotations

import struct
from statistics import quantiles

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.press_dataset import Press
from palpate_twin.demo.distribution import distribution
from palpate_twin.demo.truth import finger_figures, read_pairs, truth_of_recording, truth_of_twin, unwrapped

NODE = 0x11
CONTACT, VALID = 1, 4
START_US = 1_700_000_000_000_000
PERIOD_US = 33_333
TOUCH = (0.0, 0.0, 30.0)


def press(position_mm=None, normal_N=0.0) -> Press:
    return Press("f.jpg", "test", 0.0, position_mm, normal_N, (0.0, 0.0, 0.0), "plate", 0)


def test_latency_is_from_the_exposure_to_the_stamp_of_tpdo_3(tpdos):
    records = []
    for number, latency_us in enumerate((10_000, 20_000, 60_000)):
        exposed_us = START_US + number * PERIOD_US * 2
        records += tpdos(NODE, exposed_us + latency_us, exposed_us, number)
    pairs, incomplete = read_pairs(records, NODE, truth_of_recording([press()]))
    assert [pair.latency_us for pair in pairs] == [10_000, 20_000, 60_000]
    latency = finger_figures("f", pairs, incomplete).latency_us
    assert (latency.count, latency.mean, latency.median, latency.largest) == (3, 30_000, 20_000, 60_000)


def test_latency_survives_the_wrap_of_the_bus_clock(tpdos):
    exposed_us = (START_US // 2**32 + 1) * 2**32 - 5
    pairs, _ = read_pairs(tpdos(NODE, exposed_us + 7_000, exposed_us, 0), NODE, truth_of_recording([press()]))
    assert [pair.latency_us for pair in pairs] == [7_000]


def test_a_frame_is_paired_with_its_row_of_the_looped_recording(tpdos):
    truth = [press((float(row), 0.0, 0.0)) for row in range(5)]
    sequences = [3, 4, 5, 7, 12]  # 6 and 8 to 11 are gaps
    records = []
    for count, sequence in enumerate(sequences):
        at_us = START_US + count * PERIOD_US
        records += tpdos(NODE, at_us + 9_000, at_us, sequence)
    pairs, _ = read_pairs(records, NODE, truth_of_recording(truth))
    assert [pair.truth.position_mm[0] for pair in pairs] == [3, 4, 0, 2, 2]
    assert finger_figures("f", pairs, 0).dropped == 1 + 4


def test_the_pairing_goes_on_beyond_the_wrap_of_the_sequence(tpdos):
    truth = [press((float(row), 0.0, 0.0)) for row in range(240)]
    records = []
    for count, sequence in enumerate((65_534, 65_535, 0, 1)):
        at_us = START_US + count * PERIOD_US
        records += tpdos(NODE, at_us + 9_000, at_us, sequence)
    pairs, _ = read_pairs(records, NODE, truth_of_recording(truth))
    # 65534 = 273 * 240 + 14, and row 16 follows row 15 although the 16 bits start over
    assert [pair.truth.position_mm[0] for pair in pairs] == [14, 15, 16, 17]
    assert finger_figures("f", pairs, 0).dropped == 0


def test_errors_flags_and_refusals(tpdos):
    truth = [press(TOUCH, 2.0), press(TOUCH, 2.0), press(), press(TOUCH, 2.0), press()]
    published = [
        ((3.0, 4.0, 30.0), 2.5, VALID | CONTACT),  # 5 mm and 0.5 N off
        ((0.0, 0.0, 0.0), 0.0, VALID),  # missed: 2 N off, flag wrong
        ((0.0, 0.0, 0.0), 0.0, VALID),  # right
        ((0.0, 0.0, 30.0), 2.0, VALID | CONTACT),  # right
        ((9.0, 9.0, 9.0), 9.0, CONTACT),  # refused: counts nowhere else
    ]
    records = []
    for sequence, (position_mm, normal_N, flags) in enumerate(published):
        at_us = START_US + sequence * PERIOD_US
        records += tpdos(NODE, at_us + 9_000, at_us, sequence, position_mm, normal_N, flags)
    figures = finger_figures("f", *read_pairs(records, NODE, truth_of_recording(truth)))
    assert (figures.frames, figures.dropped, figures.refused, figures.incomplete) == (5, 0, 1, 0)
    assert figures.contact_right_percent == pytest.approx(75.0)
    assert figures.position_error_mm.count == 2
    assert figures.position_error_mm.mean == pytest.approx(2.5)
    assert figures.force_rmse_N == pytest.approx(((0.25 + 4.0) / 4) ** 0.5)
    assert figures.force_rmse_percent == pytest.approx(figures.force_rmse_N / 2.0 * 100)


def test_parts_that_make_no_frame_are_counted_and_other_nodes_left_out(tpdos):
    records = tpdos(NODE, START_US + 9_000, START_US, 0)
    records += tpdos(NODE, START_US + 42_000, START_US + PERIOD_US, 1)[:2]  # its TPDO 3 is lost
    records += tpdos(NODE + 1, START_US + 50_000, START_US + PERIOD_US, 77)
    records += tpdos(NODE, START_US + 75_000, START_US + 2 * PERIOD_US, 2)
    pairs, incomplete = read_pairs(records, NODE, truth_of_recording([press()]))
    assert [pair.sequence for pair in pairs] == [0, 2]
    assert incomplete == 1


def test_a_node_that_boots_anew_begins_a_new_sequence(tpdos):
    records = tpdos(NODE, START_US + 9_000, START_US, 500)
    records.append(LogRecord(START_US + 20_000, CanFrame(0x700 + NODE, struct.pack("B", 0))))
    records += tpdos(NODE, START_US + 42_000, START_US + PERIOD_US, 0)
    pairs, incomplete = read_pairs(records, NODE, truth_of_recording([press()]))
    assert [pair.contact.sequence for pair in pairs] == [500, 0]
    assert incomplete == 0


def test_a_finger_without_frames_has_no_figures():
    figures = finger_figures("f", [], 0)
    assert (figures.frames, figures.contact_right_percent, figures.latency_us) == (0, None, None)


@given(st.lists(st.integers(1, 1000), max_size=300), st.integers(0, 65_535))
def test_unwrapping_gives_back_what_was_wrapped(steps, first):
    true = [first]
    for step in steps:
        true.append(true[-1] + step)
    assert unwrapped([sequence % 65_536 for sequence in true]) == true


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=200))
def test_percentiles_are_those_of_the_standard_library(values):
    spread = distribution(values)
    cuts = quantiles(values, n=100, method="inclusive")
    assert spread.median == pytest.approx(cuts[49], abs=1e-6)
    assert spread.p95 == pytest.approx(cuts[94], abs=1e-6)
    assert spread.p99 == pytest.approx(cuts[98], abs=1e-6)
    assert spread.largest == max(values)


def test_the_twins_truth_goes_by_the_sequence_number(tpdos, tmp_path):
    """A truncated line and a frame that was not rendered are left out of the truth."""
    path = tmp_path / "finger.csv"
    rows = ["sequence,exposed_at_us,x_mm,y_mm,z_mm,fx_N,fy_N,fz_N"]
    rows += ["0,1000,,,,0.0,0.0,0.0", "2,3000,0.0,18.0,24.0,0.0,-0.6,-0.8", "3,40"]
    path.write_text("\n".join(rows))
    records = []
    for sequence in (0, 1, 2, 3):
        at_us = START_US + sequence * PERIOD_US
        records += tpdos(NODE, at_us + 9_000, at_us, sequence, (0.0, 18.0, 21.0), 1.5, VALID | CONTACT)
    pairs, incomplete = read_pairs(records, NODE, truth_of_twin(path))
    assert ([pair.sequence for pair in pairs], incomplete) == ([0, 2], 0)
    assert pairs[0].truth.position_mm is None
    assert pairs[1].position_error_mm == pytest.approx(3.0)
    # (0, -0.6, -0.8) N against the outward normal (0, 0.6, 0.8): 1 N.
    assert pairs[1].force_error_N == pytest.approx(0.5)


def test_a_truth_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(DatasetError, match=r"finger.csv cannot be read .*run the demo again"):
        truth_of_twin(tmp_path / "finger.csv")
