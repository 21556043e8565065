"""``palpate-host console`` as a process, over real HTTP, beside a host with simulated drives and tips."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from palpate_bus.logs.candump import read_log
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

pytestmark = pytest.mark.long


def check_a_recording(console):
    """Record the hand for a second and play it; the stop button works meanwhile."""
    code, text = console.command(command="record")
    assert code == 200, text
    folder = Path(text.removeprefix("recording "))
    code, text = console.command(command="record")
    assert code == 409 and "already" in text
    time.sleep(1.0)
    assert console.command(command="record_no_more") == (200, f"recorded {folder}")
    ticks = list(read_statuses(folder, *load_hand(console.config)))
    assert len(ticks) > 10 and read_log(folder / "000001.log").records
    assert console.command(command="play", name=folder.name) == (200, f"playing {folder.name}")
    played = console.event(lambda kind, value: kind == "hand" and value["recording"], "not played")
    assert played["status"]["time_us"] in {status.time_us for status in ticks}
    code, text = console.command(command="release")
    assert code == 409 and "stop playing first" in text
    assert console.command(command="stop") == (200, "stop: accepted")
    console.command(command="play_no_more")  # it may have ended by itself


def test_commands_go_through_the_control_socket_and_a_host_that_dies_is_shown(console):
    assert console.mode_now()["counters"]["ticks"] > 0
    assert console.command(command="stop", token="wrong")[0] == 401
    code, text = console.command(command="rotate", rpy_deg=[5, 0, 0])
    assert code == 409 and "grasp first" in text
    status, scene = console.lead_to("grasp", command="grasp")
    assert len(status["joints"]) == 9 and len(scene["fingers"]) == 3
    assert all(finger["contact_m"] and finger["force_N"] for finger in scene["fingers"])
    bus = console.event(
        lambda kind, value: kind == "bus" and value["load"] and all(value["fingertips"]), "no news of the bus"
    )
    assert 0.01 < bus["load"] < 1 and bus["frames_s"] > 100
    assert bus["fingertips"] == [{"silicone_degC": 31.5, "led_level": 128}] * 3
    check_a_recording(console)
    console.mode("stop", "fault")
    for odd in ({"command": "status"}, {"command": "rotate", "rpy_deg": [500, 0, 0]}, {"command": "fly"}, {}):
        code, text = console.command(**odd)
        assert code == 409 and "not a command" in text
    assert console.command(command="record", token="wrong")[0] == 401
    console.kill_host()
    code, text = console.command(command="record")
    assert code == 409 and "no hand is running" in text
    lost = console.event(lambda kind, value: kind == "state" and not value["connected"], "not shown")
    assert "host" in lost["text"] or "no hand is running" in lost["text"]
    code, text = console.command(command="stop")
    assert code == 409 and "no hand is running" in text
