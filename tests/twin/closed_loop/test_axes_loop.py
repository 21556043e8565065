"""The closed loop on the simulated hand with one drive node a finger, beside the same with one a joint."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.host.axes_hand import on_can_fd, with_axes

import palpate_host
from palpate_host.service.host import load_hand
from palpate_twin.closed_loop.lockstep import LockstepLoop, final_error_deg
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.trial import make_engine

TABLE_4 = Path(palpate_host.__file__).parent / "models" / "table4.toml"

pytestmark = pytest.mark.slow


def turned(config, hand):
    """Turn the object by [target] of table4.toml; return the final error and the frames on the bus."""
    engine = make_engine(config, "mujoco", has_B=False)
    loop = LockstepLoop(config, hand, engine, TrueContactSource(30.0, 0.15, 1))
    record = loop.run(5.0)
    assert record.failure == ""
    return final_error_deg(record, config.target.rpy_deg)[0], record.bus_frames


def test_axes_turn_the_object_as_drives_with_a_node_each_and_with_fewer_frames():
    """pytest -s prints both errors."""
    config, hand = load_hand(TABLE_4)
    classic_deg, classic_frames = turned(on_can_fd(config), hand)
    axes_deg, axes_frames = turned(with_axes(config), hand)
    print(f"error with a node each {classic_deg:.2f} deg, with axes {axes_deg:.2f} deg")
    print(f"frames in 5 s {classic_frames}, with axes {axes_frames}")
    assert axes_deg == pytest.approx(classic_deg, abs=0.3)
    assert axes_frames < 0.5 * classic_frames
