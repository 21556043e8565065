"""``palpate-host console`` as a process, over real HTTP, beside a host with simulated drives and tips."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.long


def test_grasp_turn_release_and_stop_go_through_the_control_socket(console):
    status, scene = console.mode("ready")
    assert len(status["joints"]) == 9 and len(scene["fingers"]) == 3
    assert console.command(command="grasp", token="wrong")[0] == 401
    status_text = console.command(command="rotate", rpy_deg=[5, 0, 0])
    assert status_text[0] == 409 and "grasp first" in status_text[1]
    assert console.command(command="grasp") == (200, "grasp: accepted")
    console.mode("grasp")
    assert console.command(command="rotate", rpy_deg=[0, 0, 5], ramp_s=0.3) == (200, "rotate: accepted")
    status, scene = console.mode("manipulate", "blind")
    assert status["target_rpy_deg"] == [0, 0, 5]
    assert all(finger["contact_m"] and finger["force_N"] for finger in scene["fingers"])
    assert console.command(command="release") == (200, "release: accepted")
    console.mode("ready")
    assert console.command(command="stop") == (200, "stop: accepted")
    status, _ = console.mode("stop")
    assert "operator" in status["reason"]
    for odd in ({"command": "status"}, {"command": "rotate", "rpy_deg": [500, 0, 0]}, {"command": "fly"}, {}):
        code, text = console.command(**odd)
        assert code == 409 and "not a command" in text


def test_a_host_that_dies_is_shown_and_the_next_one_is_found(console):
    console.mode("ready")
    console.kill_host()
    lost = console.event(lambda kind, value: kind == "state" and not value["connected"], "not shown")
    assert "host" in lost["text"] or "no hand is running" in lost["text"]
    code, text = console.command(command="stop")
    assert code == 409 and "no hand is running" in text
    console.start_host()
    console.event(lambda kind, value: kind == "state" and value["connected"], "not found again")
    console.mode("ready", "fault")
