"""A live hand of 10 fingertips at 120 frames a second and 3 x 5 axes at 250 Hz, as cores on any CAN FD bus.

The host's core, ten fingertip nodes and three drive nodes of five axes, the same that run as processes
elsewhere. Five fingers have two joints and five have one, each axis a simulated motor. The time is an
argument, so the bus may be the hub in virtual time or the kernel's in real time.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path

import msgspec
import numpy as np

from palpate_bus.load.budget import BudgetCase, budget
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.contact import Contact
from palpate_edge.node.events import StoreRequested
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_host.common.status import HostStatus
from palpate_host.config import hand_reader
from palpate_host.config.hand_config import FingerConfig, HandConfig, JointConfig, ModelConfig, StartMode
from palpate_host.config.packaged import MODELS
from palpate_host.control.kinematics import HandKinematics
from palpate_host.network.nmt_master import SYNC
from palpate_host.service.host import hand_of
from palpate_host.service.host_core import HostCore
from palpate_twin.drives.drive_plant import JointParameters
from palpate_twin.drives.simulated_drives import SimulatedAxes

NOMINAL, DATA = 1_000_000, 5_000_000  # bit/s
FINGERTIPS, FIRST_TIP = 10, 0x10
AXES, DRIVE_NODES = 5, (1, 2, 3)
FRAMES_HZ, TICK_HZ = 120, 250
TICK_US = 1_000_000 // TICK_HZ
ESTIMATE_US = 8_000  # from an exposure to its contact in the node
LOST_US = 1_000_000
EXPOSURE_APART_US = 797  # the cameras are not synchronised
CIRCLE_M, UPRIGHT_M, LEVEL_M = 0.110, 0.10, 0.05


def _finger(number: int) -> str:
    """Return a finger of the MJCF: an upright link, with abduction where the number is even, and a dome that
    looks at the hand's axis."""
    turn = math.tau * number / FINGERTIPS
    abduction = f'<joint name="abduction_{number}" axis="1 0 0"/>' if number % 2 == 0 else ""
    return (
        f'<body pos="{CIRCLE_M * math.cos(turn)} {CIRCLE_M * math.sin(turn)} 0" euler="0 0 {turn + math.pi}">'
        f'{abduction}<joint name="flexion_{number}" axis="0 1 0"/>'
        f'<geom type="capsule" size="0.008" fromto="0 0 0 0 0 {UPRIGHT_M}"/>'
        f'<site name="tip_{number}" pos="{LEVEL_M} 0 {UPRIGHT_M}" euler="0 {math.pi / 2} 0"/></body>'
    )


def large_hand(folder: Path) -> tuple[HandConfig, HandKinematics]:
    """Return configuration and hand; its MJCF is written into `folder`."""
    numbers = range(FINGERTIPS)
    path = folder / "large_hand.xml"
    bodies = "".join(map(_finger, numbers))
    path.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody>{bodies}</worldbody></mujoco>', encoding="utf-8"
    )
    places = iter(product(DRIVE_NODES, range(AXES)))

    def joint(name: str) -> JointConfig:
        node, axis = next(places)
        return JointConfig(
            name=name,
            drive_node=node,
            axis=axis,
            direction=1,
            zero_offset_rad=0.0,
            min_rad=-0.5,
            max_rad=0.5,
            B_Nms_rad=0.07,
            torque_limit_Nm=0.5,
        )

    like = hand_reader.load(MODELS / "table4.toml")
    fingers = tuple(
        FingerConfig(
            name=f"finger-{number}",
            fingertip_node=FIRST_TIP + number,
            joints=tuple(joint(f"{kind}_{number}") for kind in (("abduction", "flexion")[number % 2 :])),
        )
        for number in numbers
    )
    config = msgspec.structs.replace(
        like.starting(StartMode.AUTO),
        model=ModelConfig(tip_sites=tuple(f"tip_{number}" for number in numbers), mjcf=str(path)),
        geometry=None,
        twin=None,
        fingers=fingers,
        control=msgspec.structs.replace(like.control, tick_Hz=TICK_HZ),
        bus=msgspec.structs.replace(like.bus, bitrate=NOMINAL, data_bitrate=DATA),
    )
    return config, hand_of(config)


@dataclass(frozen=True, slots=True)
class OnBus:
    """A frame on the bus. at_us: when it was received, or when it is sent. node_id: of the sender."""

    at_us: int
    node_id: int
    frame: CanFrame


class _Device:
    """A fingertip or drive node, and when it is due."""

    def __init__(self, node: FingertipNode | SimulatedAxes) -> None:
        self._node = node
        self.node_id = node.slave.node_id
        self.accept_ids = frozenset(node.slave.accept_ids())
        self.due_us = 0

    def process(self, now_us: int, frames: Sequence[CanFrame]) -> tuple[CanFrame, ...]:
        output = self._node.process(now_us, frames)
        sent = output.frames_out
        if any(isinstance(event, StoreRequested) for event in output.events):
            self._node.slave.store_finished(True)
            output = self._node.process(now_us, ())
            sent += output.frames_out
        self.accept_ids = frozenset(self._node.slave.accept_ids())
        self.due_us = output.next_due_us
        return sent


class LiveHand:
    """The hand's cores. Give `step` what was received and the bus what it returns, and call it at `due_us`.

    status: newest status of the host.
    """

    def __init__(self, config: HandConfig, hand: HandKinematics, start_us: int) -> None:
        self._host = HostCore(config, hand)
        self.host_id = config.network.host_node
        self.host_accepts = frozenset(self._host.accept_ids)
        self.status: HostStatus | None = None
        self._host_due_us = start_us
        self._tips = [
            FingertipNode(finger.fingertip_node, MethodCode.CORRECTED, "0" * 16, data_bitrate=DATA)
            for finger in config.fingers
        ]
        drives = [SimulatedAxes(node, dict.fromkeys(range(AXES), JointParameters())) for node in DRIVE_NODES]
        self._devices = [_Device(node) for node in (*self._tips, *drives)]
        self.node_ids = [*(device.node_id for device in self._devices), self.host_id]
        self._next_frame = [(start_us + EXPOSURE_APART_US * place, 0) for place in range(FINGERTIPS)]
        self._dice = np.random.default_rng(27)

    @property
    def due_us(self) -> int:
        """The time of the next `step`, if nothing is received before."""
        devices_us = min(device.due_us for device in self._devices)
        return min(self._host_due_us, devices_us, min(self._next_frame)[0] + ESTIMATE_US)

    def step(
        self, now_us: int, to_devices: Sequence[CanFrame], to_host: Sequence[tuple[int, CanFrame]]
    ) -> list[OnBus]:
        """Process received frames, and what is due at `now_us`; return the frames to send.

        to_devices: the host's frames. to_host: those of the devices and its own SYNC, with their time stamps.
        """
        self._publish(now_us)
        sent = []
        for device in self._devices:
            own = [frame for frame in to_devices if frame.can_id in device.accept_ids]
            if own or now_us >= device.due_us:
                sent += [OnBus(now_us, device.node_id, frame) for frame in device.process(now_us, own)]
        answers = [one for one in to_host if one[1].can_id in self.host_accepts]
        if answers or now_us >= self._host_due_us:
            output = self._host.process(now_us, answers)
            self._host_due_us, self.status = output.next_due_us, output.status
            sent += [OnBus(now_us, self.host_id, frame) for frame in output.frames_out]
        return sent

    def _publish(self, now_us: int) -> None:
        """Give each fingertip the contact of its frame, ESTIMATE_US after the exposure."""
        for place, (exposed_us, sequence) in enumerate(self._next_frame):
            if now_us < exposed_us + ESTIMATE_US:
                continue
            self._next_frame[place] = (exposed_us + 1_000_000 // FRAMES_HZ, sequence + 1)
            self._tips[place].publish(self._contact(sequence, exposed_us), now_us - exposed_us)
            self._devices[place].due_us = now_us

    def _contact(self, sequence: int, exposed_us: int) -> Contact:
        """Return a contact near the apex of the dome, with noise in every quantity."""
        x, y, force = self._dice.normal((0.0, 0.0, 2.0), (1.0, 1.0, 0.3))
        return Contact(
            sequence=sequence % 0x10000,
            exposed_at_us=exposed_us,
            valid=True,
            in_contact=True,
            position_mm=(x, y, math.sqrt(30.0**2 - x * x - y * y)),
            normal_force_N=abs(force),
            force_N=(0.1 * x, 0.1 * y, abs(force)),
            torsion_Nmm=float(self._dice.normal(0.0, 2.0)),
            radius95_mm=float(abs(self._dice.normal(0.35, 0.05))),
            quality=0.8,
            reason="",
            beads_found=85,
            beads_expected=85,
        )


def budget_percent() -> float:
    """Return the mean load by the budget, without its reserve for the SDO requests of other masters."""
    case = BudgetCase(
        fingertips=FINGERTIPS,
        joints=0,
        frames_per_s=FRAMES_HZ,
        tick_Hz=TICK_HZ,
        bitrate=NOMINAL,
        data_bitrate=DATA,
        axis_nodes=(AXES,) * len(DRIVE_NODES),
        sdo_per_s=0,
    )
    return budget(case).mean_percent


def answer_times_us(frames: Sequence[OnBus], host_id: int) -> list[int]:
    """Return the time from each SYNC to the last of its answers, TPDO 1 of every drive node.

    LOST_US if one was not received before the next SYNC, which is its deadline: the host then has no joint
    angles of this tick. frames: as they were received, in the order of time.
    """
    syncs = [one.at_us for one in frames if one.node_id == host_id and one.frame == SYNC]
    answers = {
        node: deque(one.at_us for one in frames if one.frame.can_id == 0x180 + node) for node in DRIVE_NODES
    }
    took_us = []
    for sync_us, next_us in pairwise(syncs):
        slowest_us = 0
        for waiting in answers.values():
            while waiting and waiting[0] <= sync_us:
                waiting.popleft()
            in_time = waiting and waiting[0] < next_us
            slowest_us = max(slowest_us, waiting[0] - sync_us if in_time else LOST_US)
        took_us.append(slowest_us)
    return took_us
