"""A whole hand on a bus in virtual time: HostCore, nine simulated drives, three fingertip nodes.

Only cores run here, the same that run as processes elsewhere; the bus hands every frame to everybody else 100
us after the one before. A person's object is a function of time and the hand's pose that says what each dome
feels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

import palpate_host
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig, StartMode
from palpate_host.control.kinematics import HandKinematics, HandPose
from palpate_host.drives.cia402_device import DriveNode
from palpate_host.network.nmt_master import SYNC
from palpate_host.service.host import load_hand
from palpate_host.service.host_core import HostCore, HostOutput
from palpate_twin.drives.hand_drives import drives_of

TABLE_4 = Path(palpate_host.__file__).parent / "models" / "table4.toml"
START_POSE_RAD = (0.0, 0.348, 1.221)
START_US = 1_700_000_000_000_000
STEP_US = 500
FRAME_US = 100
FRAME_PERIOD_US = 33_333
DELAY_US = 40_000

Feel = Callable[[int, int, HandPose], tuple[float, float, float] | None]
Filter = Callable[[int, CanFrame], Iterable[tuple[int, CanFrame]]]


def load_table_4() -> tuple[HandConfig, HandKinematics]:
    """The packaged hand, moving by itself: a bench without an operator has nobody to give commands."""
    config, hand = load_hand(TABLE_4)
    return config.starting(StartMode.AUTO), hand


def apex_only(_finger: int, _time_us: int, _pose: HandPose) -> tuple[float, float, float]:
    """Every dome is touched at its apex all the time."""
    return (0.0, 0.0, 30.0)


def same(stamp_us: int, frame: CanFrame) -> list[tuple[int, CanFrame]]:
    """A bus without faults."""
    return [(stamp_us, frame)]


class VirtualBench:
    """Everything on one bus; `run` moves it on. `log` holds every frame that was on the bus."""

    def __init__(
        self, config: HandConfig, hand: HandKinematics, feel: Feel = apex_only, to_host: Filter = same
    ) -> None:
        self.hand = hand
        self.core = HostCore(config, hand)
        self.host_id = config.network.host_node
        self.drives = drives_of(config, START_POSE_RAD)
        self.plant_motors = [motor for drive in self.drives for motor in drive.motors]
        self.tips = [make_tip(f.fingertip_node, config.bus.data_bitrate) for f in config.fingers]
        self.feel = feel
        self.to_host = to_host
        self.now_us = START_US
        self.log: list[tuple[int, CanFrame]] = []
        self.statuses: list[HostStatus] = []
        self.output: HostOutput | None = None
        self.silent: set[int] = set()  # nodes without power; the host's id: it gets no processor
        self.cut_off: set[int] = set()  # nodes that run and neither hear nor are heard
        self._due_us: dict[int, int] = {}  # node with power -> when it wants to be asked
        self._to_nodes: list[CanFrame] = []
        self.host_queue: list[tuple[int, CanFrame]] = []  # what the host will hear when it is next asked
        self._exposed: list[tuple[int, int, int, HandPose]] = []
        self._next_exposure_us = [START_US + 11_000 * finger for finger in range(len(self.tips))]
        self._sequence = [0] * len(self.tips)

    def pose(self) -> HandPose:
        self._advance_joints()
        return self.hand.pose(np.array([motor.plant.position_rad for motor in self.plant_motors]))

    def _advance_joints(self) -> None:
        """A drive that is not asked does not look at its joint, which moves all the same."""
        for motor in self.plant_motors:
            motor.state(self.now_us)

    def wake(self, node_id: int) -> None:
        """Something was done to a node from outside of the bus: it is asked in the next step."""
        self._due_us.pop(node_id, None)

    def run(self, duration_s: float) -> HostStatus:
        """Move on; returns the last status. Stops early when the host has finished."""
        end_us = self.now_us + round(duration_s * 1e6)
        while self.now_us < end_us and not (self.output and self.output.finished):
            self._step()
        self._advance_joints()
        return self.statuses[-1]

    def _step(self) -> None:
        now_us = self.now_us
        to_nodes, self._to_nodes = self._to_nodes, []
        from_nodes = self._serve(self.drives, now_us, to_nodes)
        self._feel_and_publish(now_us)
        from_nodes += self._serve(self.tips, now_us, to_nodes)
        stamped = [(now_us + 1 + i, frame) for i, frame in enumerate(from_nodes)]
        self.log += stamped
        heard = sorted(
            [*self.host_queue, *(item for stamp, frame in stamped for item in self.to_host(stamp, frame))],
            key=lambda item: item[0],
        )
        self.now_us = now_us + STEP_US
        if self.host_id in self.silent:
            self.host_queue = heard
            return
        self.host_queue = []
        is_cut = self.host_id in self.cut_off
        self.output = self.core.process(self.now_us, [] if is_cut else heard)
        if self.output.ticked and self.output.status is not None:
            self.statuses.append(self.output.status)
        if is_cut:
            return
        self.log += [(self.now_us, frame) for frame in self.output.frames_out]
        self._to_nodes = list(self.output.frames_out)
        self.host_queue = [(self.now_us, frame) for frame in self.output.frames_out if frame == SYNC]

    def _serve(self, nodes, now_us: int, to_nodes: list[CanFrame]) -> list[CanFrame]:
        """A node is asked only when something came or is due, which is what a process does too."""
        due_us = self._due_us
        asked = nodes if to_nodes else [n for n in nodes if now_us >= due_us.get(n.slave.node_id, 0)]
        return [frame for node in asked for frame in self._served(node, now_us, to_nodes)]

    def _served(self, node, now_us: int, to_nodes: list[CanFrame]) -> list[CanFrame]:
        node_id = node.slave.node_id
        if node_id in self.silent:
            self._due_us.pop(node_id, None)
            return []
        is_cut = node_id in self.cut_off
        if is_cut and now_us < self._due_us.get(node_id, 0):
            return []
        output = node.process(now_us, [] if is_cut else to_nodes)
        frames_out = output.frames_out
        if isinstance(node, FingertipNode) and any(isinstance(e, StoreRequested) for e in output.events):
            node.slave.store_finished(True)
            output = node.process(now_us, ())
            frames_out += output.frames_out
        is_following = isinstance(node, DriveNode) and node.is_following
        self._due_us[node_id] = now_us if is_following else output.next_due_us
        return [] if is_cut else list(frames_out)

    def _feel_and_publish(self, now_us: int) -> None:
        for finger in range(len(self.tips)):
            if now_us >= self._next_exposure_us[finger]:
                self._next_exposure_us[finger] += FRAME_PERIOD_US
                self._sequence[finger] += 1
                self._exposed.append((finger, now_us, self._sequence[finger], self.pose()))
        while self._exposed and now_us >= self._exposed[0][1] + DELAY_US:
            finger, exposed_us, sequence, pose = self._exposed.pop(0)
            point = self.feel(finger, exposed_us, pose)
            self.wake(self.tips[finger].slave.node_id)
            self.tips[finger].publish(contact_at(point, sequence, exposed_us), now_us - exposed_us)


def make_tip(node_id: int, data_bitrate: int | None = None) -> FingertipNode:
    return FingertipNode(node_id, MethodCode.CORRECTED, "0" * 16, data_bitrate=data_bitrate)


def contact_at(point: tuple[float, float, float] | None, sequence: int, exposed_us: int) -> Contact:
    touching = point is not None
    return Contact(
        sequence=sequence,
        exposed_at_us=exposed_us,
        valid=True,
        in_contact=touching,
        position_mm=point,
        normal_force_N=1.0 if touching else 0.0,
        force_N=None,
        torsion_Nmm=None,
        radius95_mm=0.35 if touching else None,
        quality=1.0,
        reason="",
        beads_found=85,
        beads_expected=85,
    )
