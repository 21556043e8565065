"""Modes, orientation error and torques reconstructed from a log, against the host that made the log."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from palpate_bus.logs.candump import LogRecord
from palpate_edge.common.errors import ConfigError
from palpate_host.common.mode import Mode
from palpate_twin.demo.hand_motion import hand_figures, joint_torques, replay_modes

BENCH = Path(__file__).parents[2] / "host" / "virtual_bench.py"
RATED_NM = 1.9  # the simulated motor behind its gear: 0.095 N m at 20:1
TICK_S = 0.01


@pytest.fixture(scope="module")
def stopped_hand():
    """Run a hand with two fingers in contact and finger 3 without for 0.3 s; then the operator stops it."""
    name = "palpate_virtual_bench"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, BENCH)
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    bench = sys.modules[name]
    config, hand = bench.load_table_4()

    def feel(finger, time_us, _pose):
        lost = finger == 2 and 1_300_000 <= time_us - bench.START_US < 1_600_000
        return None if lost else (1.5 * finger, -4.0, 29.7)

    rig = bench.VirtualBench(config, hand, feel=feel)
    rig.run(2.0)
    rig.core.request_stop()
    rig.run(1.0)
    assert rig.output.finished
    return config, hand, rig, [LogRecord(stamp_us, frame) for stamp_us, frame in rig.log]


def test_replayed_modes_are_those_the_host_had(stopped_hand):
    config, hand, rig, records = stopped_hand
    begin_us = records[0].stamp_us
    figures = hand_figures(replay_modes(records, config, hand), [], begin_us)
    entered = []
    for status in rig.statuses:
        if not entered or entered[-1][0] is not status.mode:
            entered.append((status.mode, status.reason, (status.time_us - begin_us) / 1e6))
    assert [mode for mode, *_ in entered][-3:] == [Mode.BLIND, Mode.MANIPULATE, Mode.STOP]
    assert entered[-1][1] == "stopped by the operator"
    assert [(change.mode, change.reason) for change in figures.changes] == [entry[:2] for entry in entered]
    for change, (*_, time_s) in zip(figures.changes, entered, strict=True):
        assert change.time_s == pytest.approx(time_s, abs=1.5 * TICK_S)
    assert sum(figures.mode_s.values()) == pytest.approx(len(rig.statuses) * TICK_S, abs=3 * TICK_S)


def test_replayed_orientation_error_is_the_hosts(stopped_hand):
    config, hand, rig, records = stopped_hand
    seen = [m.orientation_error_deg for m in replay_modes(records, config, hand) if m.mode is Mode.MANIPULATE]
    true = [s.orientation_error_deg for s in rig.statuses if s.mode is Mode.MANIPULATE]
    assert max(seen) == pytest.approx(max(true), abs=0.1)
    assert seen[-1] == pytest.approx(true[-1], abs=0.1)


def test_torques_are_what_the_host_asked_for(stopped_hand):
    config, _, rig, records = stopped_hand
    torques = joint_torques(records, config)
    assert [torque.name for torque in torques] == [joint.name for joint in config.joints]
    for index, torque in enumerate(torques):
        # From the drives' identification on, every tick commands every drive, to 1 per mille of its torque.
        asked = [status.joints[index].command_Nm for status in rig.statuses][-len(torque.torque_Nm) :]
        assert len(torque.torque_Nm) > 250
        assert torque.torque_Nm == pytest.approx(asked, abs=RATED_NM / 1000)
        assert abs(torque.torque_Nm).max() > 0.01


def test_commands_beyond_the_limit_are_counted(stopped_hand):
    config, _, _, records = stopped_hand
    torque = joint_torques(records, config)[1]
    honest = hand_figures([], [torque], 0).joints[0]
    assert (honest.over_limit, honest.commands) == (0, len(torque.torque_Nm))
    torque.torque_Nm[5:8] = (0.51, -0.6, 0.5)
    caught = hand_figures([], [torque], 0).joints[0]
    assert (caught.over_limit, caught.largest_Nm) == (2, 0.6)


def test_a_log_without_its_start_is_refused(stopped_hand):
    config, hand, _, records = stopped_hand
    with pytest.raises(ConfigError, match=r"no rated torque of the drive of abduction_1"):
        joint_torques(records[-500:], config)
    with pytest.raises(ConfigError, match=r"no heartbeat of the host"):
        replay_modes([record for record in records if record.frame.can_id != 0x77F], config, hand)
