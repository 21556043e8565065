"""``palpate-edge setup``: what is found, what is asked, and a configuration that the programs accept."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.cli.setup import setup
from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.config import read_config
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_edge.setup.exposure import propose_exposure_us
from palpate_edge.setup.finger_file import SENSOR, SetupChoices, finger_toml, scaled_sensor_toml
from palpate_edge.setup.found import FoundBus, FoundCamera
from palpate_edge.setup.search import find_buses, find_cameras


@pytest.fixture
def folder(tmp_path: Path, drawn_dataset: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with two recordings, of the drawn sensor and of a larger picture."""
    for name, scale in (("dome", 1), ("larger", 2)):
        (tmp_path / name).mkdir()
        for number, path in enumerate(sorted((drawn_dataset / "reference").glob("*.png"))[:2]):
            image = cv2.imread(str(path))
            cv2.imwrite(str(tmp_path / name / f"{number}.png"), cv2.resize(image, None, fx=scale, fy=scale))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def nothing_connected(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine without cameras, CAN interfaces and I2C buses; network interfaces can be added."""
    empty = tmp_path_factory.mktemp("machine")
    (empty / "net").mkdir()
    find_all, find_can = find_cameras, find_buses
    monkeypatch.setattr(
        "palpate_edge.setup.search.find_cameras", lambda working: find_all(working, empty, empty)
    )
    monkeypatch.setattr("palpate_edge.setup.search.find_buses", lambda: find_can(empty / "net"))
    monkeypatch.setattr("palpate_edge.setup.search.find_lights", list)
    return empty


def run(*arguments: str, answers: str | None = None) -> str:
    return CliRunner().invoke(setup, arguments, input=answers, catch_exceptions=False).output


def test_without_questions_the_first_camera_and_bus_are_taken(folder: Path, nothing_connected: Path) -> None:
    said = run("--yes")
    assert "recorded      dome: recording of 2 frames" in said
    assert "which" not in said
    config = read_config(folder / "finger-1.toml")
    assert (config.capture.source, config.capture.path) == ("recorded", str(folder / "dome"))
    assert (config.bus.interface, config.node.id) == ("palpate", 0x10)
    assert config.estimator.calibration_required is False
    size = cv2.imread(str(folder / "dome" / "0.png")).shape[1::-1]
    assert read_sensor(folder / "finger-1-presses" / "sensor.toml").image_size_px == size
    with pytest.raises(ConfigError, match="exists: give another --name"):
        run("--yes")


@pytest.mark.parametrize(("state", "interface"), [("up", "socketcan"), ("down", "palpate")])
def test_without_questions_an_interface_that_is_down_is_not_taken(
    folder: Path, nothing_connected: Path, state: str, interface: str
) -> None:
    (nothing_connected / "net" / "can0").mkdir()
    (nothing_connected / "net" / "can0" / "type").write_text("280")
    (nothing_connected / "net" / "can0" / "operstate").write_text(state)
    run("--yes")
    assert read_config(folder / "finger-1.toml").bus.interface == interface


def test_what_is_not_unique_is_asked(folder: Path, nothing_connected: Path) -> None:
    for name, kind in (("can0", "280"), ("eth0", "1")):
        (nothing_connected / "net" / name).mkdir()
        (nothing_connected / "net" / name / "type").write_text(kind)
    (nothing_connected / "net" / "can0" / "operstate").write_text("down")
    said = run("--name", "thumb", "--node", "18", answers="2\n\n")
    assert "socketcan     can0: down; ip link set can0 up" in said and "eth0" not in said
    config = read_config(folder / "thumb.toml")
    assert config.capture.path == str(folder / "larger")
    assert (config.bus.interface, config.bus.channel, config.node.id) == ("socketcan", "can0", 18)


def test_answers_come_from_a_file_and_options_have_precedence(folder: Path, nothing_connected: Path) -> None:
    (folder / "answers.toml").write_text('name = "index"\nnode = 17\ncamera = "larger"\nchannel = "hub"\n')
    run("--answers", "answers.toml", "--node", "19")
    config = read_config(folder / "index.toml")
    assert (config.name, config.node.id, config.bus.interface) == ("index", 19, "palpate")
    (folder / "answers.toml").write_text("knot = 17\n")
    with pytest.raises(ConfigError, match="knot"):
        run("--answers", "answers.toml")


def test_a_folder_without_a_camera_names_the_option(
    tmp_path: Path, nothing_connected: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="no usable camera found: connect one, or give --camera"):
        run("--yes")
    assert list(tmp_path.iterdir()) == []


def test_simulated_cameras_and_broken_ones_are_listed(tmp_path: Path) -> None:
    for name in ("by-path", "shm", "work"):
        (tmp_path / name).mkdir()
    (tmp_path / "by-path" / "usb-0-video-index0").touch()
    (tmp_path / "shm" / "palpate-other").write_bytes(b"something else")
    with_ring = RingWriter(tmp_path / "shm" / "palpate-1234", RingFormat(640, 480, 3))
    found = find_cameras(tmp_path / "work", tmp_path / "by-path", tmp_path / "shm")
    with_ring.close()
    assert [(one.source, one.size_px, bool(one.problem)) for one in found] == [
        ("v4l2", None, True),
        ("shared_memory", (640, 480), False),
    ]


def test_the_configuration_of_a_camera_and_a_light_is_accepted(tmp_path: Path) -> None:
    choices = SetupChoices(
        name="finger-3",
        camera=FoundCamera("v4l2", "/dev/v4l/by-path/a-video-index0", "a camera"),
        bus=FoundBus("socketcan", "can1", "up"),
        node_id=0x12,
        dataset="finger-3-presses",
        exposure_us=4300,
        i2c_bus=1,
    )
    (tmp_path / "finger-3.toml").write_text(finger_toml(choices))
    config = read_config(tmp_path / "finger-3.toml")
    assert config.capture.camera.exposure_us == 4300
    assert (config.illumination.i2c_bus, config.bus.channel, config.node.id) == (1, "can1", 0x12)


def test_the_nominal_lens_is_scaled_to_the_picture(tmp_path: Path) -> None:
    (tmp_path / "sensor.toml").write_text(scaled_sensor_toml(SENSOR.read_text(), (1280, 720)))
    camera = read_sensor(tmp_path / "sensor.toml").camera
    assert (camera.width, camera.height) == (1280, 720)
    assert camera.matrix == (570.0, 570.0, 640.0, 360.0)  # 380 px at 480 rows


@pytest.mark.parametrize(
    ("level", "exposure_us", "proposed_us"),
    [
        (200, 5000, 5000),
        (190, 5000, 5000),  # right within 10 %
        (100, 5000, 10_000),
        (255, 5000, 2500),  # saturated: nobody knows by how much
        (5, 5000, 26_600),  # at most 80 % of the period of 30 frames a second
        (50, 100, 400),
        (255, 100, 100),
    ],
)
def test_an_exposure_is_proposed_from_the_brightest_pixels(
    level: int, exposure_us: int, proposed_us: int
) -> None:
    image = np.full((48, 64, 3), level, np.uint8)
    image[:24] //= 2
    assert propose_exposure_us(image, exposure_us, 30.0) == proposed_us
