"""What a sensor never gives is None at the host: in contacts, status, records, and for the control."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from pathlib import Path

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact, LabelEstimate
from palpate_edge.common.contact_quantities import SensorOutputs
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_host.cli.command import status_text
from palpate_host.common.status import FingerStatus, HostStatus
from palpate_host.config.control_config import ForceLaw
from palpate_host.control.contact_force import ContactForce
from palpate_host.control.manipulation import Manipulation
from palpate_host.network.finger_state import FingerRecord
from palpate_host.network.nodes import Nodes
from palpate_host.recording.mcap import McapRecording
from palpate_host.recording.parquet import write_parquet
from palpate_host.recording.statuses import read_statuses
from palpate_host.recording.table import write_csv
from palpate_host.safety.runaway import force_fault
from palpate_host.service.host import load_hand
from palpate_host.view.hand_view import plotted

PROJECT = Path(__file__).resolve().parents[3]
LOG = PROJECT / "tests" / "replay" / "start-up.log.gz"
HAND = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
PLACES = SensorOutputs(force=False)
POSES = SensorOutputs(place=False, force=False, pose=True)


def record_of(outputs: SensorOutputs, node_id: int = 0x10) -> FingerRecord:
    """Return a finger whose node has published one contact."""
    node = FingertipNode(node_id, MethodCode.PAPER, "0123", outputs=outputs)
    node.process(0, [CanFrame(0x000, b"\x01\x00")])
    contact = Contact(
        sequence=7,
        exposed_at_us=900_000,
        valid=True,
        in_contact=True,
        position_mm=(3.0, -4.0, 12.5) if outputs.place else None,
        normal_force_N=None,
        force_N=None,
        quality=1.0,
        reason="",
        beads_found=31,
        beads_expected=31,
        pose=(LabelEstimate("depth_mm", 1.25, 0.05),) if outputs.pose else (),
    )
    node.publish(contact, 10_000)
    finger = FingerRecord("finger-1", node_id)
    for frame in node.slave.due_tpdos(1):
        received = finger.tip.receive(1_000_000, frame)
        if received is not None:
            finger.note(received)
    assert finger.tip.counters.complete == 1
    return finger


def status_of(outputs: SensorOutputs) -> FingerStatus:
    return record_of(outputs).status(1_000_000)


@pytest.fixture(scope="module")
def tick() -> HostStatus:
    """Return a tick in which finger-1 knows the place and finger-2 the depth, neither the force."""
    last = list(read_statuses(LOG, *load_hand(HAND)))[-1]
    second = dataclasses.replace(status_of(POSES), name="finger-2")
    return dataclasses.replace(last, fingers=(status_of(PLACES), second, last.fingers[2]))


def test_place_known_and_force_unknown() -> None:
    status = status_of(PLACES)
    assert (status.valid, status.in_contact, status.position_mm) == (True, True, (3.0, -4.0, 12.5))
    assert (status.normal_force_N, status.shear_N, status.flat_pose) == (None, None, None)


def test_pose_known_and_place_unknown() -> None:
    status = status_of(POSES)
    assert (status.valid, status.in_contact, status.position_mm, status.normal_force_N) == (
        True,
        True,
        None,
        None,
    )
    assert status.flat_pose is not None
    assert (status.flat_pose.depth_mm, status.flat_pose.depth_mm_95) == (1.25, 0.05)
    assert (status.flat_pose.torsion_deg, status.flat_pose.torsion_deg_95) == (None, None)


def test_csv_and_parquet_have_no_newtons(tmp_path: Path, tick: HostStatus) -> None:
    write_csv(tmp_path / "hand.csv", [tick])
    with (tmp_path / "hand.csv").open(newline="") as file:
        (row,) = csv.DictReader(file)
    tactile = "observation.tactile.finger-"
    assert (row[f"{tactile}1.x_mm"], row[f"{tactile}1.fn_N"], row[f"{tactile}1.fx_N"]) == ("3.0", "", "")
    assert (row[f"{tactile}2.x_mm"], row[f"{tactile}2.fn_N"]) == ("", "")
    assert row[f"{tactile}1.in_contact"] == row[f"{tactile}2.in_contact"] == "True"
    assert (row["observation.depth_mm.finger-2"], row["observation.depth_mm_95.finger-2"]) == ("1.25", "0.05")
    assert (row["observation.torsion_deg.finger-2"], row["observation.depth_mm.finger-1"]) == ("", "")
    write_parquet(tmp_path / "hand.parquet", [tick])
    table = pq.read_table(tmp_path / "hand.parquet")
    vector = table.column("observation.tactile.finger-1").to_pylist()[0]
    assert vector[0] == 3.0 and all(math.isnan(number) for number in vector[3:])
    assert table.column("observation.depth_mm").to_pylist()[0][1] == 1.25


def test_mcap_has_the_place_and_no_newtons(tmp_path: Path, tick: HostStatus) -> None:
    config, hand = load_hand(HAND)
    path = tmp_path / "hand.mcap"
    with McapRecording(path, hand, [finger.name for finger in config.fingers]) as recording:
        recording.write(tick)
    said: dict[str, bytes] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            said[channel.topic] = message.data
    first, second = (json.loads(said[f"/tactile/finger-{number}/quantities"]) for number in (1, 2))
    assert (first["x_mm"], first["fn_N"], first["depth_mm"]) == (3.0, None, None)
    assert (second["x_mm"], second["fn_N"], second["depth_mm"]) == (None, None, 1.25)
    assert "/tactile/finger-1/contact" in said
    assert "/tactile/finger-2/contact" not in said
    (again,) = read_statuses(path, config, hand)
    assert again.fingers == tick.fingers


def test_plots_and_the_printed_status_have_no_newtons(tick: HostStatus) -> None:
    first, second = tick.fingers[:2]
    assert dict(plotted(first)) == {}
    assert dict(plotted(second)) == {"pose/finger-2/depth_mm": 1.25, "pose/finger-2/depth_mm_95": 0.05}
    assert "finger-1: contact, force unknown" in status_text(tick)


def test_an_unknown_force_closes_no_joint() -> None:
    """ADMITTANCE cancels the finger's command, as it does without any measurement."""
    config, _ = load_hand(HAND)
    force = ContactForce(1, msgspec.structs.replace(config.control, force_law=ForceLaw.ADMITTANCE), 1.0)
    for outputs in (PLACES, POSES):
        contact = record_of(outputs)._last
        assert contact is not None
        force.note(0, contact)
        assert force_fault("finger-1", contact, config.limits) == ""
    grasp_N = np.array([[0.0, 0.0, 2.0]])
    np.testing.assert_array_equal(force.tip_force_N(grasp_N, np.eye(3)[None], 0.01), -grasp_N)


def test_a_pose_gives_no_orientation() -> None:
    config, hand = load_hand(HAND)
    manipulation = Manipulation(config)
    contact = record_of(POSES)._last
    assert contact is not None
    pose = hand.pose(np.array([(joint.min_rad + joint.max_rad) / 2 for joint in config.joints]))
    for _ in range(20):
        for finger in range(3):
            manipulation.add_contact(finger, contact, pose)
    assert manipulation.M is None


def test_another_nodes_identifier_is_not_taken_for_a_pose() -> None:
    """0x1B0 is TPDO 1 of node 0x30; where that node is in the hand, it is nobody else's."""
    config, hand = load_hand(HAND)
    ids = (0x30, 0x10, 0x12)
    fingers = tuple(
        msgspec.structs.replace(finger, fingertip_node=node)
        for finger, node in zip(config.fingers, ids, strict=True)
    )
    nodes = Nodes(msgspec.structs.replace(config, fingers=fingers), hand)
    assert 0x1B0 in nodes.fingers[0].tip.receive_ids
    assert 0x1B0 not in nodes.fingers[1].tip.receive_ids
    assert 0x1B2 in nodes.fingers[2].tip.receive_ids
