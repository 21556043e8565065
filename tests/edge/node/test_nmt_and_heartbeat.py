"""NMT states, boot-up, heartbeat and duplicate node ids (CiA 301, 7.3.2 and 7.2.8)."""

from __future__ import annotations

import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.events import NmtStateChanged, NodeIdConflict
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.nmt import NmtCommand, NmtState
from palpate_edge.node.slave import Slave

BOOT_UP = CanFrame(0x710, b"\x00")


def nmt(command: int, node_id: int = 0x10) -> CanFrame:
    return CanFrame(0x000, bytes([command, node_id]))


def heartbeats(slave: Slave, from_us: int, to_us: int) -> list[tuple[int, int]]:
    """(time, state) of every heartbeat when the slave is called exactly when it asks to be."""
    seen = []
    now_us = from_us
    while now_us < to_us:
        output = slave.process(now_us, ())
        seen += [(now_us, frame.data[0]) for frame in output.frames_out if frame.can_id == 0x710]
        now_us = output.next_due_us
    return seen


def test_boot_up_once_then_pre_operational(fingertip: FingertipNode) -> None:
    first = fingertip.process(0, ())
    assert first.frames_out == (BOOT_UP,)
    assert first.events == (NmtStateChanged(NmtState.PRE_OPERATIONAL, None),)
    assert fingertip.process(1, ()).frames_out == ()


def test_heartbeat_every_100_ms_with_the_state(fingertip: FingertipNode) -> None:
    fingertip.process(0, ())
    assert heartbeats(fingertip.slave, 1, 300_001) == [(100_000, 127), (200_000, 127), (300_000, 127)]
    fingertip.process(300_002, (nmt(0x01),))
    assert heartbeats(fingertip.slave, 300_003, 400_001) == [(400_000, 5)]
    fingertip.process(400_002, (nmt(0x02),))
    assert heartbeats(fingertip.slave, 400_003, 500_001) == [(500_000, 4)]


def test_a_late_call_gives_one_heartbeat(fingertip: FingertipNode) -> None:
    fingertip.process(0, ())
    late = fingertip.process(950_000, ())
    assert late.frames_out == (CanFrame(0x710, b"\x7f"),)
    assert late.next_due_us == 1_050_000


def test_1017_takes_effect_at_once_and_0_turns_it_off(fingertip: FingertipNode) -> None:
    fingertip.process(0, ())
    write = CanFrame(0x610, bytes.fromhex("2b 17 10 00 0a 00 00 00"))
    assert CanFrame(0x710, b"\x7f") in fingertip.process(5_000, (write,)).frames_out
    assert heartbeats(fingertip.slave, 5_001, 25_001) == [(15_000, 127), (25_000, 127)]
    fingertip.process(25_002, (CanFrame(0x610, bytes.fromhex("2b 17 10 00 00 00 00 00")),))
    assert heartbeats(fingertip.slave, 25_003, 4_000_000) == []


@pytest.mark.parametrize(
    ("commands", "state"),
    [
        ([0x01], NmtState.OPERATIONAL),
        ([0x02], NmtState.STOPPED),
        ([0x01, 0x80], NmtState.PRE_OPERATIONAL),
        ([0x02, 0x01], NmtState.OPERATIONAL),
        ([0x01, 0x81], NmtState.PRE_OPERATIONAL),
        ([0x02, 0x82], NmtState.PRE_OPERATIONAL),
        ([0x7F], NmtState.PRE_OPERATIONAL),
    ],
)
def test_commands(fingertip: FingertipNode, commands: list[int], state: NmtState) -> None:
    fingertip.process(0, [nmt(command) for command in commands])
    assert fingertip.slave.state is state


@pytest.mark.parametrize(
    "frame",
    [nmt(0x01, 0x11), CanFrame(0x000, b"\x01"), CanFrame(0x000, b"\x01\x10\x00"), CanFrame(0x000, b"", True)],
    ids=["another node", "short", "long", "remote"],
)
def test_commands_that_are_not_for_this_node(fingertip: FingertipNode, frame: CanFrame) -> None:
    fingertip.process(0, (frame,))
    assert fingertip.slave.state is NmtState.PRE_OPERATIONAL


def test_a_command_to_all_nodes(fingertip: FingertipNode) -> None:
    fingertip.process(0, (nmt(0x01, 0),))
    assert fingertip.slave.state is NmtState.OPERATIONAL


@pytest.mark.parametrize("command", [NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION])
def test_reset_boots_again_with_the_defaults_of_the_masters_objects(
    fingertip: FingertipNode, command: NmtCommand
) -> None:
    fingertip.process(0, (CanFrame(0x610, bytes.fromhex("2b 17 10 00 00 00 00 00")),))
    output = fingertip.process(10, (nmt(command),))
    assert output.frames_out == (BOOT_UP,)
    assert output.events == (NmtStateChanged(NmtState.PRE_OPERATIONAL, command),)
    assert fingertip.slave.read(0x1017) == 100
    assert fingertip.slave.read(0x2001) == "0123456789abcdef"


@pytest.mark.parametrize("can_id", [0x710, 0x590, 0x090, 0x190, 0x290, 0x390, 0x490])
def test_a_frame_with_an_identifier_of_ours_is_a_conflict(fingertip: FingertipNode, can_id: int) -> None:
    output = fingertip.process(0, (CanFrame(can_id, b"\x00"),))
    assert NodeIdConflict(can_id) in output.events
    assert can_id in fingertip.slave.accept_ids()


def test_remote_frames_are_not_served(fingertip: FingertipNode) -> None:
    """Node guarding asks with a remote frame of our identifier: no conflict, no answer."""
    fingertip.process(0, ())
    guarding, sdo = CanFrame(0x710, b"", True), CanFrame(0x610, bytes(8), True)
    output = fingertip.process(1, (guarding, sdo))
    assert (output.frames_out, output.events) == ((), ())


@pytest.mark.parametrize("can_id", [0x711, 0x191, 0x591, 0x080, 0x091])
def test_frames_of_other_nodes_are_no_conflict(fingertip: FingertipNode, can_id: int) -> None:
    output = fingertip.process(0, (CanFrame(can_id, b"\x00"),))
    assert not any(isinstance(event, NodeIdConflict) for event in output.events)
