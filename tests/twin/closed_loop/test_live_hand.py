"""The simulated hand in real time: brakes, motion file, plain renderer, waiting for frames and commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.host.axes_hand import with_axes

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError, DatasetError
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_host.common import rotation
from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import HandConfig, StartMode
from palpate_host.service.host import load_hand
from palpate_host.service.host_core import HostCore
from palpate_twin.cli.options import PACKAGED
from palpate_twin.closed_loop.live_cameras import Exposure
from palpate_twin.closed_loop.live_hand import LiveHand
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.demo.hand_motion import HostTick
from palpate_twin.demo.turn import analyse_turns
from palpate_twin.hand.film import draw_states, write_film
from palpate_twin.hand.motion import MotionFile, TrueMotion, read_motion
from palpate_twin.paper.trial import make_engine

TABLE_4 = PACKAGED["table4-wide"]
FACE_M = 0.040  # from the object's middle to its faces


@pytest.mark.parametrize("name", ["mujoco", "eqs"])
def test_braked_joints_stand_under_gravity_and_free_ones_fall(name):
    config, _ = load_hand(TABLE_4)
    engine = make_engine(config, name, has_B=False)
    start_rad = engine.q_rad.copy()
    braked = np.arange(9) != 2  # all but the first finger's last joint
    engine.brake(braked)
    for _ in range(400):
        engine.step(np.zeros(9))
    moved_rad = engine.q_rad - start_rad
    assert np.abs(moved_rad[braked]).max() < 1e-8
    assert moved_rad[2] > 0.02  # downwards closes
    engine.brake(np.ones(9, dtype=bool))
    held_rad = engine.q_rad.copy()
    for _ in range(400):
        engine.step(np.zeros(9))
    assert engine.q_rad == pytest.approx(held_rad, abs=1e-8)
    assert np.abs(engine.object_position_m).max() < 0.2  # the object stays in the hand


def test_the_motion_file_gives_back_what_the_engine_had(tmp_path: Path):
    config, _ = load_hand(TABLE_4)
    engine = make_engine(config, "mujoco", has_B=False)
    seen = []
    with MotionFile(
        tmp_path / "motion.csv", [joint.name for joint in config.joints], len(config.fingers)
    ) as file:
        for stamp_us in (1_700_000_000_000_000, 1_700_000_000_020_000):
            for _ in range(40):
                engine.step(np.full(9, 0.05))
            file.write(stamp_us, engine)
            seen.append((engine.q_rad.copy(), engine.object_rotation, engine.object_position_m))
    with (tmp_path / "motion.csv").open("a") as cut:
        cut.write("17000,0.1")  # the end of a killed process
    motion = read_motion(tmp_path / "motion.csv")
    assert motion.stamps_us.tolist() == [1_700_000_000_000_000, 1_700_000_000_020_000]
    for row, (q_rad, R, position_m) in enumerate(seen):
        assert motion.q_rad[row] == pytest.approx(q_rad, abs=1e-6)
        assert motion.rotations[row] == pytest.approx(R, abs=1e-6)
        assert motion.pose[row, :3] == pytest.approx(position_m, abs=1e-6)
    forces_N = [0.0 if contact is None else contact.normal_force_N for contact in engine.tip_contacts()]
    assert motion.force_N[1] == pytest.approx(forces_N, rel=1e-5)


def test_a_motion_that_is_missing_or_empty_is_refused(tmp_path: Path):
    with pytest.raises(DatasetError, match="run the demo again"):
        read_motion(tmp_path / "motion.csv")
    (tmp_path / "motion.csv").write_text("time_us\n")
    with pytest.raises(DatasetError, match="contains no motion"):
        read_motion(tmp_path / "motion.csv")


def test_the_plain_drawing_shows_the_object_where_opengl_would(tmp_path: Path):
    """The object moves to the side and back, and so does the centre of its pixels."""
    config, _ = load_hand(TABLE_4)
    twin = make_engine(config, "eqs").twin
    states = [twin.start().qpos.copy() for _ in range(3)]
    states[1][twin.object_q + 2] += 0.05
    pictures = draw_states(twin, states, (240, 320), plainly=True)
    rows = []
    for picture in pictures:
        blue, green, red = (picture[..., channel].astype(int) for channel in range(3))
        is_object = (red > green + 20) & (green > blue + 20)  # MuJoCo's own mesh is (0.85, 0.65, 0.3)
        assert is_object.sum() > 500
        rows.append(np.flatnonzero(is_object.any(axis=1)).mean())
    assert rows[1] < rows[0] - 10  # higher in the picture
    assert rows[2] == rows[0]
    write_film(tmp_path / "hand.webp", pictures, 100)
    assert (tmp_path / "hand.webp").read_bytes()[8:12] == b"WEBP"


def test_the_plain_camera_is_mujocos():
    """Position and direction equal those of MuJoCo's free camera in a MuJoCo scene."""
    from palpate_twin.hand.plain_drawing import _View

    twin = make_engine(load_hand(TABLE_4)[0], "eqs").twin
    camera = mujoco.MjvCamera()
    camera.lookat = np.array([0.01, -0.02, 0.1])
    camera.distance, camera.azimuth, camera.elevation = 0.5, 60.0, -35.0
    scene, data = mujoco.MjvScene(twin.model, maxgeom=100), twin.start()
    mujoco.mjv_updateScene(
        twin.model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene
    )
    place = (np.array(scene.camera[0].pos) + np.array(scene.camera[1].pos)) / 2  # of both eyes
    view = _View(camera, (240, 320))
    assert view.place == pytest.approx(place, abs=1e-6)
    assert view.pixel(np.array(camera.lookat)) == (160, 120)


def test_turns_are_separated_by_their_commands():
    """Two turns 1 deg behind the target at half the speed of real time; the second slips by 1.1 mm."""
    begin_us, tick_us = 1_700_000_000_000_000, 40_000
    roll_rad = np.radians([0.0, 5.0, 10.0, 10.0, 10.0, 5.0, 0.0, 0.0])
    stamps_us = begin_us + tick_us * np.arange(len(roll_rad))

    def about_x(angles):
        return [rotation.exp(np.array([angle, 0.0, 0.0])) for angle in angles]

    ticks = [
        HostTick(int(stamp), Mode.MANIPULATE, "", 0.0, np.eye(3), R)
        for stamp, R in zip(stamps_us, about_x(roll_rad), strict=True)
    ]
    behind = roll_rad - np.radians(1.0) * (np.arange(len(roll_rad)) > 0)
    half = behind / 2
    pose = np.stack([0 * half, 0 * half, 0 * half, np.cos(half), np.sin(half), 0 * half, 0 * half], axis=1)
    slip_mm = np.zeros((8, 3))
    slip_mm[5:, 1] = 1.1
    force_N = np.full((8, 3), 2.0)
    motion = TrueMotion(
        stamps_us.astype(float), np.zeros(8), np.zeros((8, 9)), pose, slip_mm, force_N, 0.2 * force_N
    )
    requests = [(begin_us, (10.0, 0.0, 0.0)), (begin_us + 4 * tick_us - 10, (-10.0, 0.0, 0.0))]
    turned = analyse_turns(ticks, motion, begin_us, requests)
    assert turned is not None
    there, back = turned[1].steps
    assert (there.rpy_deg, back.rpy_deg) == (requests[0][1], requests[1][1])
    assert (there.begin_s, there.end_s, back.end_s) == pytest.approx((0.0, 0.16, 0.28))
    assert there.error_deg == pytest.approx(1.0) and back.error_deg == pytest.approx(1.0)
    assert (there.name, there.outcome) == ("roll +10 deg", "reached within 1.00 deg, no slip (0.00 mm)")
    slipped = "reached within 1.00 deg, SLIPPED by 1.10 mm (limit 1 mm)"
    assert (back.name, back.outcome) == ("roll -10 deg", slipped)
    missed = replace(back, error_deg=3.01, rpy_deg=(5.0, 0.0, -7.5), slip_mm=(0.0, 0.0, 0.0))
    assert (missed.name, missed.outcome) == (
        "roll +5, yaw -7.5 deg",
        "MISSED by 3.01 deg (limit 3 deg), no slip (0.00 mm)",
    )
    assert (there.verdict, back.verdict, missed.verdict) == ("", "SLIPPED", "MISSED")
    assert (there.pace, turned[1].pace) == pytest.approx((0.5, 0.5))
    assert there.friction_ratio == pytest.approx(0.2)


class Cameras:
    """Stand-in for the camera process: `busy` lists the fingers whose frame is being rendered."""

    def __init__(self) -> None:
        self.fps = [30.0] * 3
        self.busy: set[int] = set()
        self.exposures: list[Exposure] = []

    def is_busy(self, finger: int) -> bool:
        return finger in self.busy

    def expose(self, exposure: Exposure) -> None:
        self.exposures.append(exposure)


class Bench:
    """Live hand, fingertip nodes and host core on a bus without delay, in steps of 1 ms.

    late_ms: delay of the host's frames; contact_ms: time from exposure to contact; silent: fingers that
    publish no contact; count_from: first sequence number of the fingertips. changed: makes another hand of
    Table 4's.
    """

    def __init__(
        self, folder: Path, changed: Callable[[HandConfig], HandConfig] = lambda config: config
    ) -> None:
        config, kinematics = load_hand(TABLE_4)
        config = changed(config)
        self.now_us = self.start_us = 1_700_000_000_000_000
        self.cameras = Cameras()
        self.motion = MotionFile(
            folder / "motion.csv", [joint.name for joint in config.joints], len(config.fingers)
        )
        engine = make_engine(config, "mujoco", has_B=False)
        self.hand = LiveHand(config, kinematics, engine, self.cameras, self.motion, self.now_us, self.now_us)
        self.host = HostCore(config.starting(StartMode.AUTO), kinematics)
        rate = config.bus.data_bitrate
        self.tips = [
            FingertipNode(f.fingertip_node, MethodCode.CORRECTED, "0" * 16, data_bitrate=rate)
            for f in config.fingers
        ]
        self.late_ms, self.contact_ms, self.count_from = 0, 10, 0
        self.silent: set[int] = set()
        self._to_hand: list[tuple[int, CanFrame]] = []
        self._contacts = TrueContactSource(30.0, 0.0, 1)
        self._processed = 0
        self.mode = Mode.INIT

    def run(self, ms: int) -> None:
        for _ in range(ms):
            self.now_us += 1000
            arrived = [(s, f) for s, f in self._to_hand if s + 1000 * self.late_ms <= self.now_us]
            self._to_hand = self._to_hand[len(arrived) :]
            sent, _ = self.hand.process(self.now_us, [(self.now_us, frame) for _, frame in arrived])
            received = [frame for _, frame in arrived]
            while (
                self._processed < len(self.cameras.exposures)
                and self.cameras.exposures[self._processed].exposed_at_us + 1000 * self.contact_ms
                <= self.now_us
            ):
                exposure = self.cameras.exposures[self._processed]
                self._processed += 1
                if exposure.finger in self.silent:
                    continue
                number = self.count_from + exposure.sequence
                contact = self._contacts.contact(
                    exposure.finger, exposure.contact, exposure.exposed_at_us, number
                )
                self.tips[exposure.finger].publish(contact, self.now_us - exposure.exposed_at_us)
            for tip in self.tips:
                sent += tip.process(self.now_us, received).frames_out
            output = self.host.process(self.now_us, [(self.now_us, frame) for frame in sent])
            responses = [frame for frame in sent if frame.can_id in self.hand.accept_ids]
            both = [*responses, *output.frames_out]
            self._to_hand += [(self.now_us, frame) for frame in both]
            if output.status is not None:
                self.mode = output.status.mode


@pytest.fixture
def turning(tmp_path):
    """Return a hand that turns its object and has not had to wait."""
    bench = Bench(tmp_path)
    bench.run(1800)
    assert bench.mode is Mode.MANIPULATE
    assert bench.hand.waited_us == 0
    yield bench
    bench.motion.__exit__(None, None, None)


def test_a_live_hand_with_axes_turns_without_waiting(tmp_path):
    """A finger's drives are axes of one node, whose PDOs the host enables."""
    bench = Bench(tmp_path, with_axes)
    with bench.motion:
        bench.run(2000)
        assert bench.mode is Mode.MANIPULATE
        assert bench.hand.waited_us == 0
        heartbeat = CanFrame(0x702, bytes([5]))
        with pytest.raises(BusError, match="0x02 is taken: frame"):
            bench.hand.process(bench.now_us + 1000, [(bench.now_us + 1000, heartbeat)])


def test_another_node_with_a_drives_id_ends_a_live_hand(turning):
    heartbeat = CanFrame(0x700 + load_hand(TABLE_4)[0].joints[4].drive_node, bytes([5]))
    now_us = turning.now_us + 1000
    with pytest.raises(BusError, match="is taken: frame"):
        turning.hand.process(now_us, [(now_us, heartbeat)])


def test_a_live_hand_waits_for_commands_no_longer_than_for_a_slow_host(turning):
    """Without commands, the hand stops 2 ticks and 2 ms after the angles of the last command.

    After a second it continues, so that its drives detect that the host has ended.
    """
    before_us = turning.hand.simulated_us
    turning.late_ms = 10_000
    turning.run(400)
    assert turning.hand.simulated_us - before_us <= 22_000
    turning.run(1000)
    assert turning.hand.simulated_us - before_us > 300_000


def test_a_live_hand_waits_for_angles_to_be_known(turning):
    """With a delay of 15 ms, every command is based on angles older than one tick: the hand slows down."""
    before_us = turning.hand.simulated_us
    turning.late_ms = 15
    turning.run(1000)
    assert 200_000 < turning.hand.simulated_us - before_us < 800_000
    assert turning.mode is Mode.MANIPULATE


def test_a_live_hand_waits_for_a_picture(turning):
    before_us = turning.hand.simulated_us
    turning.cameras.busy = {1}
    turning.run(300)
    assert turning.hand.simulated_us - before_us <= 34_000  # at most a frame on
    turning.cameras.busy.clear()
    turning.run(100)
    assert turning.hand.simulated_us - before_us >= 90_000
    sequences = [exposure.sequence for exposure in turning.cameras.exposures if exposure.finger == 1]
    assert sequences == list(range(len(sequences)))


def test_a_live_hand_waits_for_contacts(turning):
    """With contacts 120 ms late, a camera's next exposure waits for the contact of the last one."""
    turning.contact_ms = 120
    turning.run(500)
    before_us, before = turning.hand.simulated_us, len(turning.cameras.exposures)
    turning.run(1200)
    assert turning.hand.simulated_us - before_us == pytest.approx(10 * 1e6 / 30, abs=20_000)
    assert len(turning.cameras.exposures) - before == pytest.approx(3 * 10, abs=3)


def test_a_picture_that_is_lost_is_not_waited_for_long(turning):
    """A finger without contacts delays each of its exposures by 200 ms, but only for the first second."""
    before = len(turning.cameras.exposures)
    turning.silent = {1}
    turning.run(900)
    taken = [exposure.finger for exposure in turning.cameras.exposures[before:]]
    assert 3 <= taken.count(1) <= 6
    turning.run(1000)
    taken = [exposure.finger for exposure in turning.cameras.exposures[before:]]
    assert taken.count(1) > 15


def test_a_fingertip_may_restart_its_sequence_numbers(turning):
    """A fingertip restarts them when it reopens its camera."""
    turning.count_from = 1000
    before_us = turning.hand.simulated_us
    turning.run(500)
    assert turning.hand.simulated_us - before_us > 490_000
