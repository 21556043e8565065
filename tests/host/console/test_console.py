"""``palpate-host console`` as a process, over real HTTP, beside a host with simulated drives and tips."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.long


def test_commands_go_through_the_control_socket_and_a_host_that_dies_is_shown(console):
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
    for odd in ({"command": "status"}, {"command": "rotate", "rpy_deg": [500, 0, 0]}, {"command": "fly"}, {}):
        code, text = console.command(**odd)
        assert code == 409 and "not a command" in text
    console.kill_host()
    lost = console.event(lambda kind, value: kind == "state" and not value["connected"], "not shown")
    assert "host" in lost["text"] or "no hand is running" in lost["text"]
    code, text = console.command(command="stop")
    assert code == 409 and "no hand is running" in text
