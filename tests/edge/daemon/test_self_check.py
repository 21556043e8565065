"""What is ok, what is a warning and what a failure, part by part."""

from __future__ import annotations

import msgspec
import pytest
from tests.health_of_a_fingertip import BEADS, BUS, CAMERA, CLOCK
from tests.health_of_a_fingertip import REPORT as HEALTHY

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.can_bus.bus_counters import BusCounters
from palpate_edge.daemon.check_rows import (
    CheckRow,
    Verdict,
    as_table,
    counter_rows,
    exit_status,
    judge_beads,
    judge_bus,
    judge_camera,
    judge_clock,
    judge_light,
)
from palpate_edge.daemon.config import CaptureConfig, FingertipConfig, NodeConfig
from palpate_edge.daemon.health import BusHealth, HealthReport, LightHealth
from palpate_edge.daemon.loaded_configuration import configuration_digest
from palpate_edge.daemon.self_check import check

change = msgspec.structs.replace


@pytest.mark.parametrize(
    ("row", "verdict", "says"),
    [
        (judge_camera(CAMERA, 200), Verdict.OK, ""),
        (judge_camera(change(CAMERA, age_ms=201.0), 200), Verdict.FAIL, "/dev/v4l/by-path/x gives no"),
        (judge_camera(change(CAMERA, age_ms=None), 200), Verdict.FAIL, "check its cable"),
        (judge_camera(change(CAMERA, fps=15.0), 200), Verdict.WARN, "exposure_us"),
        (judge_camera(change(CAMERA, fps=15.0, wanted_fps=None), 200), Verdict.OK, ""),
        (judge_camera(change(CAMERA, dropped=20, dropped_share=0.02), 200), Verdict.WARN, "too slow"),
        (judge_camera(change(CAMERA, dropped=20), 200), Verdict.OK, ""),
        (judge_beads(BEADS), Verdict.OK, ""),
        (judge_beads(change(BEADS, found=70)), Verdict.WARN, "clean the dome"),
        (judge_beads(change(BEADS, found=9, reason="only 9 of 85 beads found")), Verdict.FAIL, "only 9"),
        (judge_bus(BUS), Verdict.OK, ""),
        (judge_bus(change(BUS, state="bus-off")), Verdict.FAIL, "termination"),
        (judge_bus(change(BUS, error_passive=True)), Verdict.WARN, "error passive"),
        (judge_bus(change(BUS, dropped=9, dropped_lately=4)), Verdict.WARN, "4 PDOs dropped in the last"),
        (judge_bus(change(BUS, dropped=9)), Verdict.OK, ""),
        (judge_clock(CLOCK), Verdict.OK, ""),
        (judge_clock(change(CLOCK, state="free")), Verdict.WARN, "palpate-host run"),
        (judge_clock(change(CLOCK, state="lost")), Verdict.FAIL, "does the host run?"),
        (judge_clock(change(CLOCK, error_us=201)), Verdict.WARN, "overloaded"),
    ],
    ids=lambda one: one.part if isinstance(one, CheckRow) else "",
)
def test_verdicts_and_ways_out(row, verdict, says):
    assert row.verdict is verdict
    assert says in row.way_out
    assert bool(row.way_out) == (verdict is not Verdict.OK)


def test_a_script_is_told_of_failures_alone():
    warning = judge_beads(change(BEADS, found=70))
    assert exit_status([judge_bus(BUS), warning]) == 0
    assert exit_status([judge_bus(BUS), warning, judge_bus(change(BUS, state="down"))]) == 1


@pytest.mark.parametrize(
    ("bus", "word"),
    [
        (change(BUS, conflict="node id 0x10 is used twice: ..."), "used twice"),
        (change(BUS, stuck=True), "accepts no frame"),
    ],
)
def test_an_open_bus_that_is_of_no_use_fails(bus, word):
    row = judge_bus(bus)
    assert row.verdict.value == "fail"
    assert word in row.way_out


def test_the_table_has_a_line_for_each_part_and_each_way_out():
    lines = as_table([judge_bus(BUS), judge_bus(change(BUS, state="down"))]).splitlines()
    assert [line.split()[0] for line in lines] == ["ok", "fail", "->"]


LIGHT = LightHealth(level=200, led_degC=41.0, silicone_degC=27.5, faults="", problem="")


@pytest.mark.parametrize(
    ("light", "verdict", "word"),
    [
        (LIGHT, "ok", "27.5 degC"),
        (change(LIGHT, faults="over temperature"), "warn", "over temperature"),
        (change(LIGHT, led_degC=None, problem="check power and wiring"), "fail", "wiring"),
    ],
)
def test_the_light_is_judged(light, verdict, word):
    row = judge_light(light)
    assert row.verdict.value == verdict
    assert word in row.value + row.way_out


REPORT = change(
    HEALTHY,
    camera=change(CAMERA, damaged=1001),
    beads=change(BEADS, lost=1002, searches=1003, drift_px=1004.0),
    bus=change(
        BUS,
        retries=1005,
        dropped=1006,
        restarts=1007,
        receive_overruns=1008,
        error_frames=1009,
        foreign_frames=1010,
        own_echoes=1017,
        others_dropped=1018,
        id_conflicts=1019,
    ),
    clock=change(CLOCK, steps=1011, rejected=1012),
    light=change(LIGHT, losses=1013, triggers=1014, pec_errors=1015),
    recording_left_out=1016,
)


def test_every_counter_is_in_the_table():
    table = as_table(counter_rows(REPORT))
    for number in range(1001, 1020):
        assert str(number) in table, f"counter {number}"
    assert all(row.verdict is Verdict.OK for row in counter_rows(REPORT))


def test_every_counter_of_an_open_bus_is_in_the_health_report():
    assert set(BusCounters.__struct_fields__) - {"send_retries"} <= {
        field.name for field in msgspec.structs.fields(BusHealth)
    }  # a fingertip never waits to send: its retries are those of ReconnectingBus


def test_receive_overruns_of_the_last_minute_are_a_warning():
    lately = change(REPORT, bus=change(REPORT.bus, overruns_lately=7))
    (row,) = [row for row in counter_rows(lately) if row.verdict is not Verdict.OK]
    assert (row.part, row.verdict) == ("bus errors", Verdict.WARN)
    assert "lost received frames 7 times in the last minute" in row.way_out


def test_a_health_report_of_an_earlier_version_is_read():
    """Counters that it does not have are 0."""
    old = msgspec.to_builtins(REPORT)
    for part, names in {
        "camera": ["damaged"],
        "beads": ["lost", "searches", "drift_px"],
        "bus": [
            *("receive_overruns", "overruns_lately", "error_frames", "foreign_frames"),
            *("own_echoes", "others_dropped", "id_conflicts", "stuck", "conflict"),
        ],
        "light": ["losses", "triggers", "pec_errors"],
    }.items():
        for name in names:
            del old[part][name]
    del old["recording_left_out"]
    assert msgspec.convert(old, HealthReport).bus.receive_overruns == 0


@pytest.fixture
def config() -> FingertipConfig:
    return FingertipConfig(
        name="finger-1",
        capture=CaptureConfig(source="recorded"),
        node=NodeConfig(id=16),
        bus=BusConfig(interface="palpate"),
    )


def test_check_warns_of_a_configuration_that_was_not_loaded(config):
    for loaded, verdict in ((configuration_digest(config), "ok"), ("0" * 64, "warn")):
        rows = check(config, change(REPORT, configuration=loaded))
        (row,) = [row for row in rows if row.part == "configuration"]
        assert row.verdict.value == verdict
        assert ("restart the fingertip" in row.way_out) == (verdict == "warn")


def test_a_daemon_of_an_earlier_version_has_no_such_row(config):
    assert "configuration" not in [row.part for row in check(config, REPORT)]
