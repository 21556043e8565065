"""docs/integrations.md: three commands for each system. Their options exist, and those for Foxglove are run.

`make ros-test` and `make lerobot-test` run those for ROS 2 and LeRobot, the test of the demo's log those for
datasets.
"""

from __future__ import annotations

import re
import shlex
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.docs.test_help_examples import PROGRAMS, parse
from tests.host.hand_on_hub import PATIENCE_S, hand_on_the_bus
from tests.host.recording.test_live_server import SUBPROTOCOL, TOPICS, Client
from tests.integrations_page import PAGE, all_commands, commands, shell
from websockets.sync.client import connect

from palpate_host.cli.foxglove import foxglove

SYSTEMS = {
    "Foxglove, live": "palpate-host foxglove",
    "ROS 2": "ros2 topic",
    "ros2_canopen": "cd hand_bus/config/hand && dcfgen",
    "Recording, replay and teleoperation": "lerobot-record",
    "Datasets of recorded runs": "lerobot-dataset-viz",
    "Rerun": "palpate-host view",
}
"""Heading, and the beginning of the last of its commands."""


@pytest.mark.parametrize("heading", SYSTEMS)
def test_a_system_takes_three_commands(heading: str) -> None:
    lines = commands(heading)
    assert len(lines) == 3
    assert lines[-1].startswith(SYSTEMS[heading])


OURS = [line for line in all_commands() if re.match(r"(\w+: )?(ROS_\w+=\d+ )?palpate-host ", line)]


READ = ("hand.toml", "left.toml", "right.toml", "turns/run/hand.toml", "turns/run/bus.log", "RECORDING")


@pytest.mark.parametrize("line", OURS)
def test_the_options_of_a_command_exist(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """click parses each command; the files that it reads are made."""
    monkeypatch.chdir(tmp_path)
    for name in READ:
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).touch()
    words = shlex.split(line.removesuffix(" &"))
    words = words[words.index("palpate-host") + 1 :]
    parse(PROGRAMS["palpate-host"], "palpate-host", words)


def test_the_page_names_each_command_of_an_integration() -> None:
    assert len(OURS) >= 12
    named = {line.split("palpate-host ")[1].split()[0] for line in OURS}
    assert named >= {"foxglove", "ros", "lerobot", "view"}


@pytest.fixture
def running_hand(tmp_path: Path) -> Iterator[Path]:
    """A folder with the hand.toml of drives and touched fingertips, which run on a hub."""
    with hand_on_the_bus(tmp_path) as folder:
        yield folder


@pytest.mark.long
def test_the_commands_for_foxglove_serve_a_running_hand(running_hand: Path) -> None:
    """As they stand on the page, except that the port is a free one."""
    (port,) = (option.default for option in foxglove.params if option.name == "port")
    assert f"`ws://localhost:{port}`" in PAGE.read_text()
    *first, last = commands("Foxglove, live")
    with shell([*first, f"{last} --port 0"], running_hand) as process:
        assert process.stderr is not None
        address = (
            next(line for line in process.stderr if line.startswith("foxglove: ")).split()[1].rstrip(",")
        )
        with connect(address, subprotocols=[SUBPROTOCOL], max_queue=None) as connection:  # type: ignore[list-item]
            client = Client(connection, len(TOPICS))
            assert {one["topic"]: one["schemaName"] for one in client.channels.values()} == TOPICS
            end_s = time.monotonic() + PATIENCE_S
            found = {}
            while not found.keys() >= {"/host/status", "/joint_states"}:
                assert time.monotonic() < end_s, f"only {sorted(found)}"
                topic, _, message = client.receive(PATIENCE_S)
                found[topic] = message
    assert len(found["/joint_states"].joints) == len(found["/host/status"]["joints"]) == 9
    assert (running_hand / "hand-layout.json").stat().st_size > 1000
