"""What the viewer is given, read back by Rerun's own reader and compared with the log it came from."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from bench.tick import NumpyHand
from click.testing import CliRunner, Result
from rerun.chunk import RrdReader

from palpate_edge import Calibration
from palpate_edge.calibration.calibration_file import save_calibration
from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.recorder import FrameRing, RingLimits
from palpate_edge.geometry.points import distances
from palpate_edge.vision.unknown_layout import beads_without_layout
from palpate_host.cli.main import cli
from palpate_host.common.status import HostStatus
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand
from palpate_host.view.geometry import shapes

PROJECT = Path(__file__).resolve().parents[3]
LOG = PROJECT / "tests" / "replay" / "virtual.log.gz"
HAND = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
PATIENCE_S = 60.0
UNTOUCHED, PRESSED = "reference/000.png", "frames/train_00000.jpg"
"""Frames of the press sample; the press is of 1.3 N beside the apex."""
Table = dict[str, dict[str, list[tuple[int | None, Any]]]]  # entity -> component -> (time in ns, value)


def view(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["view", "--config", str(HAND), *map(str, arguments)])


def read(path: Path) -> Table:
    found: Table = defaultdict(lambda: defaultdict(list))
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        times = batch["time"].cast("int64").to_pylist() if "time" in names else [None] * batch.num_rows
        for name in names:
            if ":" in name:
                rows = zip(times, batch[name].to_pylist(), strict=True)
                found[chunk.entity_path][name] += [(at, value) for at, value in rows if value is not None]
    for components in found.values():
        for rows in components.values():
            rows.sort(key=lambda row: row[0] or 0)
    return found


@pytest.fixture(scope="module")
def statuses() -> list[HostStatus]:
    return list(read_statuses(LOG, *load_hand(HAND)))


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Table:
    path = tmp_path_factory.mktemp("view") / "hand.rrd"
    done = view(LOG, "--save", path, "--scene-hz", 1000)
    assert done.exit_code == 0, done.stderr
    return read(path)


def values(shown: Table, entity: str, component: str = "Scalars:scalars") -> list[tuple[int | None, Any]]:
    return shown[entity][component]


def test_plots_are_the_log(shown: Table, statuses: list[HostStatus]) -> None:
    """Every tick of every joint and finger, at its time."""
    for index, name in enumerate(joint.name for joint in statuses[0].joints):
        joints = [(1000 * status.time_us, status.joints[index]) for status in statuses]
        torques = [(at, [joint.torque_Nm]) for at, joint in joints]
        places = [(at, [joint.position_rad]) for at, joint in joints if joint.position_rad is not None]
        assert len(places) > 100
        assert values(shown, f"/torque/{name}") == torques
        commands = [(at, [joint.command_Nm]) for at, joint in joints if joint.command_Nm is not None]
        assert len(commands) > 390
        assert values(shown, f"/command/{name}") == commands
        assert values(shown, f"/position/{name}") == places
    for index, finger in enumerate(statuses[0].fingers):
        forces = [(1000 * s.time_us, [s.fingers[index].normal_force_N or 0.0]) for s in statuses]
        assert values(shown, f"/force/{finger.name}") == forces
        assert max(value[0] for _, value in forces) > 0.5
    errors = [
        (1000 * s.time_us, [s.orientation_error_deg]) for s in statuses if s.orientation_error_deg is not None
    ]
    assert errors and values(shown, "/orientation/error_deg") == errors


def test_tips_are_where_plain_kinematics_have_them(shown: Table, statuses: list[HostStatus]) -> None:
    """Table 4's hand by bench/tick.py, which knows nothing of MuJoCo."""
    config, _ = load_hand(HAND)
    kinematics = NumpyHand(config)
    known = [s for s in statuses if all(joint.position_rad is not None for joint in s.joints)]
    for index, finger in enumerate(config.fingers):
        places = values(shown, f"/hand/{finger.name}", "Transform3D:translation")
        assert [at for at, _ in places] == [1000 * s.time_us for s in known]
        for status, (_, place) in list(zip(known, places, strict=True))[::20]:
            q_rad = np.array([joint.position_rad for joint in status.joints], dtype=float)
            assert place[0] == pytest.approx(kinematics.pose(q_rad).tip_centre_m[index], abs=1e-6)


def test_contacts_and_their_arrows_are_the_log(shown: Table, statuses: list[HostStatus]) -> None:
    """Points in F, m; arrows of 10 mm a newton that point to the dome's centre."""
    for index, finger in enumerate(statuses[0].fingers):
        told = {
            1000 * s.time_us: s.fingers[index]
            for s in statuses
            if s.fingers[index].in_contact and s.joints[0].position_rad is not None
        }
        points = dict(values(shown, f"/hand/{finger.name}/contact", "Points3D:positions"))
        arrows = dict(values(shown, f"/hand/{finger.name}/force", "Arrows3D:vectors"))
        points = {at: value for at, value in points.items() if value}
        assert set(points) == set(told) and len(told) > 100
        for at, contact in told.items():
            assert contact.position_mm is not None and contact.normal_force_N is not None
            assert points[at][0] == pytest.approx(1e-3 * np.array(contact.position_mm), abs=1e-7)
            arrow = np.array(arrows[at][0])
            assert np.linalg.norm(arrow) == pytest.approx(0.010 * contact.normal_force_N, abs=1e-6)
            if contact.normal_force_N:
                assert arrow @ np.array(contact.position_mm) < 0


def test_what_the_host_says_is_there(shown: Table, statuses: list[HostStatus]) -> None:
    texts = [value[0] for _, value in values(shown, "/log", "TextLog:text")]
    assert texts[0].startswith("init: ")
    assert {text.split(":")[0] for text in texts} == {s.mode.value for s in statuses}


def test_links_of_the_hand_are_drawn(shown: Table) -> None:
    """Three links of three fingers: capsules of Table 4's lengths from the link's base."""
    lengths = {1: 0.052, 2: 0.050, 3: 0.085}
    for finger in (1, 2, 3):
        for link, length_m in lengths.items():
            (entity,) = [name for name in shown if name.startswith(f"/hand/link_{finger}_{link}/geom")]
            ((_, drawn),) = shown[entity]["Capsules3D:lengths"]
            ((_, foot),) = shown[entity]["Capsules3D:translations"]
            ((_, middle),) = shown[entity]["Transform3D:translation"]
            assert drawn[0] == pytest.approx(length_m)
            assert middle[0][2] + foot[0][2] == pytest.approx(0.0, abs=1e-6)
            assert shown[f"/hand/link_{finger}_{link}"]["Transform3D:quaternion"]


def test_every_shape_of_mujoco_has_its_own() -> None:
    """Sizes as MuJoCo's manual gives them: radius, half length, half sides."""
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><asset><mesh name="m" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset><worldbody>
        <geom name="plane" type="plane" size="1 1 1"/>
        <body name="b">
          <geom name="sphere" size="0.1"/>
          <geom name="ellipsoid" type="ellipsoid" size="0.1 0.2 0.3"/>
          <geom name="box" type="box" size="0.1 0.2 0.3" rgba="1 0 0 1"/>
          <geom name="cylinder" type="cylinder" size="0.1 0.2"/>
          <geom name="capsule" type="capsule" size="0.1 0.2"/>
          <geom name="mesh" type="mesh" mesh="m"/>
        </body></worldbody></mujoco>""")
    drawn = {entity: shape for entity, _, shape in shapes(model)}
    assert set(drawn) == {
        f"b/{kind}" for kind in ("sphere", "ellipsoid", "box", "cylinder", "capsule", "mesh")
    }
    half = {"sphere": [0.1] * 3, "ellipsoid": [0.1, 0.2, 0.3], "box": [0.1, 0.2, 0.3]}
    for kind, sides in half.items():
        assert drawn[f"b/{kind}"].half_sizes.as_arrow_array().to_pylist()[0] == pytest.approx(sides)
    for kind in ("cylinder", "capsule"):
        assert drawn[f"b/{kind}"].lengths.as_arrow_array().to_pylist() == pytest.approx([0.4])
    assert drawn["b/box"].colors.as_arrow_array().to_pylist() == [0xFF0000FF]
    assert len(drawn["b/mesh"].vertex_positions.as_arrow_array()) == 4


def test_live_from_the_hosts_socket_with_pictures(tmp_path: Path, statuses: list[HostStatus]) -> None:
    socket_path, ring_path, saved = tmp_path / "host.sock", tmp_path / "ring", tmp_path / "live.rrd"
    ring = RingWriter(ring_path, RingFormat(32, 24, 1, 4, ""))
    server = OperatorSocket(socket_path)
    command = [
        sys.executable,
        "-m",
        "palpate_host.cli.main",
        "view",
        "--config",
        HAND,
        "--socket",
        socket_path,
    ]
    command += ["--save", saved, "--camera", f"finger-1={ring_path}"]
    process = subprocess.Popen([str(part) for part in command], stdout=subprocess.PIPE, text=True)

    def is_followed() -> bool:
        server.serve(lambda _: None, None)
        return any(client.streams for client in server._clients.values())

    wait_for(is_followed, "the viewer")
    for status in statuses:
        server.serve(lambda _: None, status)
        time.sleep(0.01)
    ring.write(np.full((24, 32), 77, dtype=np.uint8), 1, time.monotonic_ns() // 1000)
    time.sleep(1.0)
    process.terminate()
    said, _ = process.communicate(timeout=PATIENCE_S)
    ring.close()
    server.close()
    shown = read(saved)
    torques = dict(values(shown, "/torque/curl_1"))
    assert process.returncode == 0 and f"view: {len(torques)} ticks" in said
    told = {1000 * status.time_us: [status.joints[2].torque_Nm] for status in statuses}
    assert len(torques) > len(told) // 2
    assert all(told[at] == value for at, value in torques.items())
    ((taken_ns, _),) = shown["/camera/finger-1"]["EncodedImage:blob"]
    assert abs(taken_ns - time.time_ns()) < 60e9


def test_recorded_pictures_come_at_their_exposures(tmp_path: Path, statuses: list[HostStatus]) -> None:
    frames = FrameRing(tmp_path / "frames", RingLimits(10_000_000, 100.0))
    begin_us = statuses[0].time_us
    for number in range(5):
        image = np.full((24, 32), 10 * number, dtype=np.uint8)
        frames.add(Frame(image, begin_us + 33_000 * number, number, ""))
    frames.write_index()
    done = view(LOG, "--save", tmp_path / "x.rrd", "--camera", f"finger-2={tmp_path / 'frames'}")
    assert done.exit_code == 0, done.stderr
    pictures = read(tmp_path / "x.rrd")["/camera/finger-2"]["EncodedImage:blob"]
    assert [at for at, _ in pictures] == [1000 * (begin_us + 33_000 * number) for number in range(5)]


def test_beads_are_drawn_over_the_blobs_of_the_pictures(
    tmp_path: Path,
    statuses: list[HostStatus],
    shared_data: Callable[[str], Path],
    sample_calibration: Calibration,
) -> None:
    """An untouched and a pressed dome: each drawn bead lies on a blob that is found without the layout."""
    calibration = tmp_path / "finger-2.cal"
    save_calibration(sample_calibration, calibration)
    sample = shared_data("press-sample")
    images = [read_image(sample / name) for name in (UNTOUCHED, PRESSED)]
    frames = FrameRing(tmp_path / "frames", RingLimits(10_000_000, 100.0))
    for number, image in enumerate(images):
        frames.add(Frame(image, statuses[0].time_us + 33_000 * number, number, ""))
    frames.write_index()
    camera = f"finger-2={tmp_path / 'frames'}"
    done = view(
        *(LOG, "--save", tmp_path / "x.rrd", "--camera", camera),
        *("--calibration", f"finger-2={calibration}"),
    )
    assert done.exit_code == 0, done.stderr
    shown = read(tmp_path / "x.rrd")
    points = shown["/camera/finger-2/beads"]["Points2D:positions"]
    motion = shown["/camera/finger-2/motion"]["Arrows2D:vectors"]
    assert len(points) == len(motion) == len(images)
    for image, (_, drawn) in zip(images, points, strict=True):
        blobs, _, _ = beads_without_layout(image, None)
        apart_px = distances(np.array(drawn) - 0.5, blobs.position_px).min(axis=1)
        assert len(drawn) > 0.9 * len(sample_calibration.beads)
        assert np.median(apart_px) < 0.5 and np.mean(apart_px < 2.0) > 0.95
    still_px, pressed_px = (np.linalg.norm(value, axis=1) for _, value in motion)
    assert np.median(still_px) < 0.5 and pressed_px.max() > 5 * still_px.max()


@pytest.mark.filterwarnings("ignore:RRD file has no footer")  # the viewer was told to end
def test_a_viewer_that_runs_is_given_the_hand(tmp_path: Path, statuses: list[HostStatus]) -> None:
    """Rerun's own program receives on loopback and saves what came, without a window."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    rerun = Path(sys.executable).with_name("rerun")
    saved = tmp_path / "got.rrd"
    command = [rerun, "--bind", "127.0.0.1", "--port", port, "--save", saved]
    home = os.environ | {"HOME": str(tmp_path)}  # where nobody has agreed to statistics
    words = [str(part) for part in command]
    process = subprocess.Popen(words, env=home, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        wait_for(lambda: _listens(port), "the viewer")
        done = view(LOG, "--connect", f"rerun+http://127.0.0.1:{port}/proxy")
        assert done.exit_code == 0, done.stderr
        time.sleep(1.0)
    finally:
        os.killpg(process.pid, signal.SIGTERM)  # `rerun` is a script that starts the program
        process.wait(timeout=PATIENCE_S)
    wait_for(lambda: not _listens(port), "the viewer's end")
    assert len(values(read(saved), "/torque/curl_1")) == len(statuses)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((LOG, "--socket", "x.sock"), "leave one out"),
        ((LOG, "--save", "x.rrd", "--connect", "rerun+http://127.0.0.1:1/proxy"), "exclude each other"),
        ((LOG, "--save", "x.rrd", "--camera", "finger-1"), "write NAME=PATH"),
        ((LOG, "--save", "x.rrd", "--camera", "finger-1=nowhere"), "nowhere: no such file or folder"),
        ((LOG, "--save", "x.rrd", "--calibration", "finger-1=x.cal"), "no --camera has this name"),
        ((LOG, "--save", "x.rrd", "--calibration", "x.cal"), "write NAME=PATH, as in finger-1=finger-1.cal"),
    ],
)
def test_what_cannot_be_shown_is_said(
    host_refused: Callable[..., str], arguments: tuple[object, ...], message: str
) -> None:
    assert message in host_refused("view", "--config", HAND, *arguments)


def wait_for(condition: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, f"{what} did not come"
        time.sleep(0.02)


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
