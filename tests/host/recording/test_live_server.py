"""The Foxglove server, with a client of another library: every topic comes with the schema it names."""

from __future__ import annotations

import base64
import json
import re
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from websockets.sync.client import ClientConnection, connect

from palpate_edge.common.errors import ConfigError
from palpate_host.cli.main import cli
from palpate_host.common.status import HostStatus
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.live_server import LiveServer, layout
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

PROJECT = Path(__file__).resolve().parents[3]
LOG = PROJECT / "tests" / "replay" / "virtual.log.gz"
HAND = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
SUBPROTOCOL = "foxglove.sdk.v1"
MESSAGE = struct.Struct("<BIQ")  # opcode 1, subscription, log time in ns
PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def statuses() -> list[HostStatus]:
    return list(read_statuses(LOG, *load_hand(HAND)))


@pytest.fixture
def server() -> Iterator[LiveServer]:
    with closing(LiveServer(*load_hand(HAND), "127.0.0.1", 0)) as running:
        yield running


class Client:
    """Subscribes to every channel; decodes each message by the schema that came with the channel."""

    def __init__(self, connection: ClientConnection, topics: int) -> None:
        self._connection = connection
        self.channels: dict[int, dict[str, Any]] = {}
        while len(self.channels) < topics:
            told = json.loads(connection.recv(PATIENCE_S))
            if told["op"] == "advertise":
                self.channels |= {channel["id"]: channel for channel in told["channels"]}
        wanted = [{"id": number, "channelId": number} for number in self.channels]
        connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def receive(self, timeout_s: float = PATIENCE_S) -> tuple[str, int, Any]:
        """Return topic, log time and the decoded message."""
        while isinstance(data := self._connection.recv(timeout_s), str):
            continue
        opcode, subscription, time_ns = MESSAGE.unpack_from(data)
        assert opcode == 1
        channel, payload = self.channels[subscription], data[MESSAGE.size :]
        return channel["topic"], time_ns, decoded(channel, payload)


def decoded(channel: dict[str, Any], payload: bytes) -> Any:
    if channel["encoding"] == "json":
        return json.loads(payload)
    assert channel["encoding"] == channel["schemaEncoding"] == "protobuf"
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"])).FromString(payload)


FINGER_TOPICS = {
    f"/tactile/finger-{number}/{what}": schema
    for number in (1, 2, 3)
    for what, schema in (
        ("contact", "foxglove.Point3InFrame"),
        ("force", "foxglove.SceneUpdate"),
        ("quantities", "palpate.Quantities"),
    )
}
TOPICS = {
    "/joint_states": "foxglove.JointStates",
    "/joint_commands": "foxglove.JointStates",
    "/tf": "foxglove.FrameTransforms",
    "/object": "foxglove.PoseInFrame",
    "/diagnostics": "foxglove.Log",
    "/host/status": "palpate.HostStatus",
} | FINGER_TOPICS


def test_a_client_gets_every_topic_with_the_schema_it_names(
    server: LiveServer, statuses: list[HostStatus]
) -> None:
    """It subscribes late, after the hand has touched: mode and contacts are sent again."""
    turning = [status for status in statuses if status.mode.value == "manipulate"]
    server.write(turning[0])
    with connect(f"ws://127.0.0.1:{server.port}", subprotocols=[SUBPROTOCOL], max_queue=None) as connection:  # type: ignore[list-item]
        assert connection.subprotocol == SUBPROTOCOL
        client = Client(connection, len(TOPICS))
        assert {channel["topic"]: channel["schemaName"] for channel in client.channels.values()} == TOPICS
        for channel in client.channels.values():
            if channel["encoding"] == "json":
                assert json.loads(channel["schema"])["title"] == channel["schemaName"]
        found = messages_of_all_topics(client, server, turning[1:])
    assert found["/host/status"]["mode"] == "manipulate"
    assert [joint.name for joint in found["/joint_states"].joints] == [j.name for j in turning[0].joints]
    assert found["/diagnostics"].message.startswith("manipulate: ")
    assert found["/tactile/finger-1/quantities"]["fn_N"] is not None


def messages_of_all_topics(client: Client, server: LiveServer, statuses: list[HostStatus]) -> dict[str, Any]:
    """Serve ticks until a message of every topic has come; topic -> message."""
    found: dict[str, Any] = {}
    for status in statuses:
        server.write(status)
        with suppress(TimeoutError):  # the subscription takes a moment
            topic, _, message = client.receive(0.01)
            found.setdefault(topic, message)
        if set(found) == set(TOPICS):
            return found
    raise AssertionError(f"no message of {set(TOPICS) - set(found)}")


def test_an_address_that_is_in_use_is_named(server: LiveServer) -> None:
    with pytest.raises(ConfigError, match=f"127.0.0.1:{server.port} cannot be listened on"):
        LiveServer(*load_hand(HAND), "127.0.0.1", server.port)


SCHEMAS_OF_3D = {"foxglove.SceneUpdate", "foxglove.PoseInFrame", "foxglove.FrameTransforms"}
"""Those of our topics that the 3D panel draws: "Panel support" in Foxglove's reference of its schemas."""


def test_the_layout_shows_what_is_served(
    server: LiveServer, statuses: list[HostStatus], tmp_path: Path
) -> None:
    """Each panel of the arrangement is configured; each path selects a value in a message of its topic."""
    path = tmp_path / "layout.json"
    done = CliRunner().invoke(cli, ["foxglove", "--config", str(HAND), "--layout", str(path)])
    assert done.exit_code == 0, done.stderr
    config, _ = load_hand(HAND)
    assert path.read_text() == layout(config)
    whole = json.loads(path.read_text())
    panels = whole["configById"]
    assert sorted(leaves(whole["layout"])) == sorted(panels)
    turning = [status for status in statuses if status.mode.value == "manipulate"]
    with connect(f"ws://127.0.0.1:{server.port}", subprotocols=[SUBPROTOCOL], max_queue=None) as connection:  # type: ignore[list-item]
        found = messages_of_all_topics(Client(connection, len(TOPICS)), server, turning)
    paths = [entry["value"] for panel in panels.values() for entry in panel.get("paths", ())]
    assert len(paths) == 3 + 1 + 9 + 1
    for value in paths:
        topic, _, rest = value.partition(".")
        assert len(selected(found[topic], rest)) == 1, value
    assert {TOPICS[topic] for topic in panels["3D!hand"]["topics"]} <= SCHEMAS_OF_3D
    assert panels["3D!hand"]["followTf"] in {one.parent_frame_id for one in found["/tf"].transforms}
    assert TOPICS[panels["RosOut!log"]["topicToRender"]] == "foxglove.Log"


PART = re.compile(r'(\w+)(\[:\])?(?:\{(\w+)=="([^"]*)"\})?')
"""A part of a message path of Foxglove: a field, a slice of all elements, a filter of them."""


def selected(message: Any, path: str) -> list[Any]:
    """Return what a path selects; a field that the message's schema lacks is a KeyError or AttributeError."""
    values = [message]
    for part in path.split("."):
        match = PART.fullmatch(part)
        assert match is not None, part
        field, is_slice, key, wanted = match.groups()
        values = [value[field] if isinstance(value, dict) else getattr(value, field) for value in values]
        if is_slice:
            values = [element for value in values for element in value]
        if key:
            values = [value for value in values if getattr(value, key) == wanted]
    return values


def leaves(part: Any) -> list[str]:
    return [part] if isinstance(part, str) else leaves(part["first"]) + leaves(part["second"])


def test_the_command_serves_what_the_host_publishes(tmp_path: Path, statuses: list[HostStatus]) -> None:
    control = tmp_path / "host.sock"
    host = OperatorSocket(control)
    command = [sys.executable, "-m", "palpate_host.cli.main", "foxglove", "--config", str(HAND)]
    process = subprocess.Popen(
        [*command, "--port", "0", "--socket", str(control)], stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stderr is not None
        address = process.stderr.readline().split()[1].rstrip(",")
        assert address.startswith("ws://127.0.0.1:")
        with connect(address, subprotocols=[SUBPROTOCOL], max_queue=None) as connection:  # type: ignore[list-item]
            client = Client(connection, len(TOPICS))
            sent = set()
            end_s = time.monotonic() + PATIENCE_S
            for status in statuses * 100:
                host.serve(lambda _command: None, status)
                sent.add(status.time_us)
                time.sleep(0.005)
                if len(sent) % 50 == 0 or time.monotonic() > end_s:
                    break
            while (got := client.receive())[0] != "/host/status":
                continue
            assert got[2]["time_us"] in sent and got[1] == 1000 * got[2]["time_us"]
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)
        host.close()
    assert process.returncode == 0
