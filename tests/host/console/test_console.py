"""``palpate-host console`` as a process, over real HTTP, beside a host with simulated drives and tips."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.long


def test_commands_go_through_the_control_socket_and_a_host_that_dies_is_shown(console):
    assert console.mode_now()["counters"]["ticks"] > 0
    assert console.command(command="stop", token="wrong")[0] == 401
    code, text = console.command(command="rotate", rpy_deg=[5, 0, 0])
    assert code == 409 and "grasp first" in text
    status, scene = console.lead_to("grasp", command="grasp")
    assert len(status["joints"]) == 9 and len(scene["fingers"]) == 3
    assert all(finger["contact_m"] and finger["force_N"] for finger in scene["fingers"])
    assert console.command(command="stop") == (200, "stop: accepted")
    console.mode("stop", "fault")
    for odd in ({"command": "status"}, {"command": "rotate", "rpy_deg": [500, 0, 0]}, {"command": "fly"}, {}):
        code, text = console.command(**odd)
        assert code == 409 and "not a command" in text
    console.kill_host()
    lost = console.event(lambda kind, value: kind == "state" and not value["connected"], "not shown")
    assert "host" in lost["text"] or "no hand is running" in lost["text"]
    code, text = console.command(command="stop")
    assert code == 409 and "no hand is running" in text
