"""The actions of `palpate-host ros` with real action clients, on the twin's hand and its real host."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.host.ros.action_clients import ABORTED, CANCELED, EXECUTING, SUCCEEDED, ActionClients
from tests.host.ros.conftest import Listener, domain, running_bridge, wait_for
from tests.host.ros.twin_on_socket import WIDE, TwinOnSocket

from palpate_host.common.mode import Mode
from palpate_host.config.packaged import MODELS

pytestmark = pytest.mark.ros
FOUR = MODELS / "table4-four.toml"
GAIT_RAD = 0.3
FOUR_FINGERS = "reorient: the turn is refused: a hand of 3 fingers holds with too few while one lifts"


@pytest.fixture(scope="module")
def client() -> Iterator[ActionClients]:
    with pytest.MonkeyPatch.context() as monkeypatch:
        domain(monkeypatch)
        with closing(Listener()) as listener:
            yield ActionClients(listener)


@pytest.fixture(scope="module")
def socket(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hand") / "s"


@pytest.fixture(scope="module")
def bridged(client: ActionClients, socket: Path) -> Iterator[None]:
    with running_bridge(WIDE, socket, "--commands"):
        yield


@pytest.fixture
def twin(socket: Path, bridged: None) -> Iterator[TwinOnSocket]:
    made = TwinOnSocket(socket)
    yield made
    made.end_abruptly()


def test_grasp_turn_and_move_succeed_and_the_object_is_there(
    twin: TwinOnSocket, client: ActionClients
) -> None:
    from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
    from std_msgs.msg import Header

    status, grasped = client.result(client.send("grasp"))
    assert (status, grasped.grasped, grasped.reason) == (SUCCEEDED, True, "")
    start = twin.rotation
    status, turned = client.result(client.turn(0.1, duration=1.0))
    assert (status, turned.reached, turned.reason) == (SUCCEEDED, True, "")
    assert 0.0 <= turned.orientation_error <= 0.02
    done = Rotation.from_matrix(twin.rotation @ start.T).as_rotvec()
    np.testing.assert_allclose(done, (0.0, 0.0, 0.1), atol=0.03)
    assert len(client.feedback) >= 5
    assert {one.mode for one in client.feedback} <= {"grasp", "manipulate"}
    shares = [one.turned for one in client.feedback]
    assert sorted(shares) == shares and shares[0] < 0.5 and shares[-1] == 1.0
    start_m = twin.position_m
    pose = PoseStamped(
        header=Header(frame_id="hand"),
        pose=Pose(position=Point(z=0.003), orientation=Quaternion(w=1.0)),
    )
    status, moved = client.result(client.send("move", pose=pose, duration=1.0))
    assert (status, moved.reached) == (SUCCEEDED, True)
    assert 0.0 <= moved.position_error <= 0.001
    np.testing.assert_allclose(twin.position_m - start_m, (0.0, 0.0, 0.003), atol=1e-3)


def test_a_refused_goal_has_its_reason_on_the_topic_response(
    twin: TwinOnSocket, client: ActionClients
) -> None:
    from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3

    client.result(client.send("grasp"))  # ends the turn with which the twin begins
    cube = [Point(x=x, y=y, z=z) for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (0.08, 0.12)]
    far = PoseStamped(pose=Pose(position=Point(x=0.5), orientation=Quaternion(w=1.0)))
    wait_for(lambda: client.refusals, "the last response")
    for name, fields, reason in (
        ("move", {"pose": far}, "move: move is refused: 500.0 mm from where the hold began"),
        ("reorient", {"rpy": Vector3(z=1.5), "corners": cube}, FOUR_FINGERS),
        ("turn", {"tolerance": -1.0}, "turn: tolerance = -1 is not within 0 and 3.14159"),
        ("turn", {"duration": math.nan}, "turn: duration = nan is not within 0 and 600"),
    ):
        before = len(client.refusals)
        assert not client.send(name, **fields).accepted
        wait_for(lambda: len(client.refusals) > before, "the reason")  # noqa: B023 - called at once
        assert client.refusals[-1][1].data.startswith(reason)


def test_a_canceled_turn_holds_the_object_where_it_is(twin: TwinOnSocket, client: ActionClients) -> None:
    handle = client.turn(0.5, duration=20.0)
    wait_for(lambda: client.feedback and client.feedback[-1].turned > 0.05, "the turn")
    assert handle.status == EXECUTING
    canceled = handle.cancel_goal_async()
    wait_for(canceled.done, "the response to cancel")
    assert len(canceled.result().goals_canceling) == 1
    status, result = client.result(handle)
    assert (status, result.reached) == (CANCELED, False)
    assert result.reason == "canceled: the object is held where it was"
    wait_for(lambda: twin.statuses[-1].mode is Mode.GRASP, "the hold")
    held = twin.rotation
    ticks = len(twin.statuses)
    wait_for(lambda: len(twin.statuses) > ticks + 50, "half a second")
    assert (Rotation.from_matrix(twin.rotation @ held.T)).magnitude() < math.radians(0.5)


def test_a_later_goal_or_command_replaces_a_turn(twin: TwinOnSocket, client: ActionClients) -> None:
    first = client.turn(0.3, duration=20.0)
    second = client.turn(-0.05, duration=20.0)
    status, result = client.result(first)
    assert (status, result.reason) == (ABORTED, "replaced by turn")
    client.send("grasp")  # of this bridge; an operator's command is the same for the host
    status, result = client.result(second)
    assert (status, result.reason) == (ABORTED, "replaced by grasp")


def test_a_finger_that_loses_contact_aborts_the_turn_and_the_hand_holds(
    twin: TwinOnSocket, client: ActionClients
) -> None:
    handle = client.turn(0.3, duration=30.0)
    wait_for(lambda: twin.statuses[-1].mode is Mode.MANIPULATE, "the turn")
    twin.contacts.lost.add(1)
    status, result = client.result(handle)
    assert (status, result.reached) == (ABORTED, False)
    assert result.reason == "hold: finger-2: no contact for more than 1000 ms"
    twin.contacts.lost.clear()
    wait_for(lambda: twin.statuses[-1].mode is Mode.GRASP, "the hold without a turn")
    ticks = len(twin.statuses)
    wait_for(lambda: len(twin.statuses) > ticks + 100, "a second")
    assert {status.mode for status in twin.statuses[ticks:]} == {Mode.GRASP}


def test_a_target_out_of_reach_aborts_at_the_timeout(twin: TwinOnSocket, client: ActionClients) -> None:
    status, result = client.result(client.turn(0.05, duration=0.5, tolerance=1e-6, timeout=1.5))
    assert (status, result.reached) == (ABORTED, False)
    assert result.reason.startswith("not within 1.5 s (manipulate: ")
    wait_for(lambda: twin.statuses[-1].mode is Mode.GRASP, "the hold")


def test_a_stop_aborts_the_turn(twin: TwinOnSocket, client: ActionClients, listener: Listener) -> None:
    handle = client.turn(0.3, duration=30.0)
    assert listener.call("stop").success
    status, result = client.result(handle)
    assert (status, result.reason) == (ABORTED, "stop: stopped by the operator")


def test_a_host_that_is_lost_aborts_the_turn(twin: TwinOnSocket, client: ActionClients) -> None:
    handle = client.turn(0.3, duration=30.0)
    wait_for(lambda: client.feedback, "a tick of the turn")
    twin.end_abruptly()
    status, result = client.result(handle)
    assert status == ABORTED
    assert result.reason.startswith("no host: ")


def test_a_turn_by_gaiting_succeeds_and_the_object_is_there(
    client: ActionClients, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The twin's hand of four fingers on a socket and in a namespace of its own."""
    from geometry_msgs.msg import Point, Vector3

    socket = tmp_path_factory.mktemp("four") / "s"
    with running_bridge(FOUR, socket, "--commands", "--namespace", "four"), closing(Listener()) as listener:
        twin = TwinOnSocket(socket, FOUR)
        try:
            clients = ActionClients(listener, "/four/")
            assert clients.result(clients.send("grasp"))[0] == SUCCEEDED
            wait_for(lambda: twin.statuses[-1].mode is Mode.GRASP, "the hold")
            start = twin.rotation
            corners = [Point(x=x, y=y, z=z) for x, y, z in twin.corners_m().tolist()]
            handle = clients.send("reorient", rpy=Vector3(z=GAIT_RAD), corners=corners)
            status, turned = clients.result(handle)
            assert (status, turned.reached, turned.reason) == (SUCCEEDED, True, "")
            true_rad = Rotation.from_matrix(twin.rotation @ start.T).as_rotvec()
        finally:
            twin.end_abruptly()
    assert true_rad == pytest.approx((0.0, 0.0, GAIT_RAD), abs=math.radians(2.0))
    assert clients.feedback[-1].mode == "manipulate"
