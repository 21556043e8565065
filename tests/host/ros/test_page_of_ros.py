"""The three commands for ROS 2 of docs/integrations.md (make ros-test)."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.host.hand_on_hub import hand_on_the_bus
from tests.host.ros.conftest import Listener, wait_for
from tests.integrations_page import commands, shell


@pytest.fixture
def running_hand(tmp_path: Path) -> Iterator[Path]:
    """A folder with the hand.toml of drives and touched fingertips, which run on a hub."""
    with hand_on_the_bus(tmp_path) as folder:
        yield folder


@pytest.mark.ros
@pytest.mark.usefixtures("real_time")
def test_the_commands_of_the_page_publish_a_running_hand(listener: Listener, running_hand: Path) -> None:
    """The wheels lack `ros2`, so this process subscribes to the topic."""
    from geometry_msgs.msg import WrenchStamped

    *first, last = commands("ROS 2")
    program, group, verb, topic = shlex.split(last)
    assert (program, group, verb) == ("ros2", "topic", "echo")
    received = listener.subscribe(WrenchStamped, topic)
    with shell(first, running_hand):
        wait_for(lambda: len(received) >= 3, "a wrench")
        grasp = ("/grasp", ["std_srvs/srv/Trigger"])
        wait_for(lambda: grasp in listener.node.get_service_names_and_types(), "a service of --commands")
    assert received[-1][1].header.frame_id == "tip_1"
    assert received[-1][1].wrench.force.z < 0.0  # the fingertips are touched
