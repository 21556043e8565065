"""Shared fixtures: a drawn sensor that needs no recorded data, and the recorded data beside the project."""

from __future__ import annotations

import fcntl
import gc
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import hypothesis
import numpy as np
import pytest
from numpy.typing import NDArray

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import load_calibration, save_calibration
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.arrays import Array
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.calibration import Calibration
from palpate_host.cli.main import main as host_main

pytest_plugins = (
    "tests.tiers",
    "tests.browser.browser_fixture",
    "kernel_guest.forwarding",
    "kernel_guest.links",
    "kernel_guest.cameras",
    "kernel_guest.usb_cameras",
    "kernel_guest.hub_bridge",
    "kernel_guest.canopennode_build",
    "kernel_guest.canopennode",
)

# FFmpeg reads this once, at the first video that a process opens; the command line sets it before, but a test
# that ran earlier in this process may have opened one. test_run.py sees the command line's own doing.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

# A process holds thousands of tests, whose objects Python's collector would visit again and again: this took
# an eighth of the time.
gc.set_threshold(50_000, 20, 50)

# No test asserts an absolute time; hypothesis would, 200 ms an example, and fail on a loaded machine. Where
# nothing may skip, it draws the same examples each time: what fails there is the change, not the draw.
hypothesis.settings.register_profile("palpate", deadline=None, derandomize="PALPATE_NO_SKIP" in os.environ)
hypothesis.settings.load_profile("palpate")

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
STIFFNESS_N_MM = 0.8
HEADER = "frame,split,t_s,x_mm,y_mm,z_mm,fn_N,fx_N,fy_N,fz_N,probe,lost\n"


@pytest.fixture(scope="session", autouse=True)
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of this test process's default sockets and health files.

    The tests and the programs that they start do not reach a hub, host or fingertip that runs on the machine
    or in another test process.
    """
    folder = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as environment:
        for name in ("PALPATE_HUB", "RUNTIME_DIRECTORY"):
            environment.delenv(name, raising=False)
        environment.setenv("XDG_RUNTIME_DIR", str(folder))
        environment.setenv("PALPATE_CONTROL", str(folder / "host.sock"))  # before /run of an installed host
        yield folder


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """A folder of the recorded data beside the project; the test is skipped where it is not there."""

    def folder(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.is_dir():
            pytest.skip(f"../shared/data/{name} is missing")
        return path

    return folder


@dataclass(frozen=True)
class DrawnDome:
    """A dome of beads drawn by plain trigonometry: its places are the truth that the tests compare with.

    offset_mm, tilt_rad (about x, then about y) and focal_scale are what the camera is off from nominal.
    bead_bgr, skin_bgr: colours. Pictures are grey when `colour` is False.
    """

    rings: tuple[tuple[float, int, float], ...] = (
        (0, 1, 0),
        (15, 6, 0),
        (30, 12, 15),
        (45, 18, 0),
        (60, 24, 7.5),
        (75, 24, 0),
    )
    width: int = 320
    height: int = 240
    focal_px: float = 190.0
    offset_mm: tuple[float, float, float] = (0.4, -0.3, 0.3)
    tilt_rad: tuple[float, float] = (0.01, -0.008)
    focal_scale: float = 1.01
    bead_bgr: tuple[float, float, float] = (30, 30, 30)
    skin_bgr: tuple[float, float, float] = (150, 155, 165)
    noise: float = 1.5

    def beads_mm(self) -> Array:
        """Bead centres (n, 3) in F."""
        points = []
        for theta_deg, count, phi0_deg in self.rings:
            for number in range(count):
                theta, phi = math.radians(theta_deg), math.radians(phi0_deg + 360 * number / count)
                points.append(
                    (
                        26.5 * math.sin(theta) * math.cos(phi),
                        26.5 * math.sin(theta) * math.sin(phi),
                        26.5 * math.cos(theta),
                    )
                )
        return np.array(points)

    def project(self, points_mm: Array) -> Array:
        """(n, 3) in F -> (n, 2) pixels by a pinhole camera turned about x, then about y."""
        x, y, z = (points_mm - np.array([0.0, 0.0, -45.0]) - self.offset_mm).T
        a, b = self.tilt_rad
        x, z = math.cos(b) * x - math.sin(b) * z, math.sin(b) * x + math.cos(b) * z
        y, z = math.cos(a) * y + math.sin(a) * z, -math.sin(a) * y + math.cos(a) * z
        focal = self.focal_px * self.focal_scale
        return np.stack([self.width / 2 + focal * x / z, self.height / 2 + focal * y / z], axis=1)

    def pressed_mm(self, theta_rad: float, phi_rad: float, depth_mm: float) -> Array:
        """Bead centres (n, 3) under a press: a smooth dent that pushes inwards and spreads sideways."""
        beads = self.beads_mm()
        normal = _unit(theta_rad, phi_rad)
        along = beads @ normal / 26.5
        angle = np.arccos(np.clip(along, -1, 1))
        sideways = beads / 26.5 - along[:, None] * normal
        bump = depth_mm * np.exp(-((angle / 0.45) ** 2))
        return np.asarray(beads - bump[:, None] * normal + 0.9 * bump[:, None] * sideways / 0.45)

    def picture(self, beads_mm: Array, seed: int, hidden: tuple[int, ...] = ()) -> NDArray[np.uint8]:
        """The camera's image (height, width, 3) of beads at these places."""
        return self.draw(self.project(beads_mm), self._sizes_px(beads_mm), seed, hidden)

    def draw(
        self, at_px: Array, diameter_px: Array, seed: int, hidden: tuple[int, ...] = ()
    ) -> NDArray[np.uint8]:
        """A shaded disk of skin with round beads (n, 2), (n,) at exactly these places, and noise."""
        row, column = np.mgrid[0 : self.height, 0 : self.width].astype(np.float32)
        centre = at_px.mean(axis=0)
        reach = np.linalg.norm(at_px - centre, axis=1).max() + 1.3 * diameter_px.max()
        radius = np.hypot(column - centre[0], row - centre[1])
        shade = (1 - 0.35 * (radius / reach) ** 2) * np.clip(reach - radius, 0, 1)
        image = 12 + shade[..., None] * np.asarray(self.skin_bgr, dtype=np.float32)
        for number, ((x, y), size) in enumerate(zip(at_px, diameter_px, strict=True)):
            if number in hidden:
                continue
            left, top, half = int(x - size), int(y - size), int(2 * size) + 2
            window = np.s_[max(0, top) : top + half, max(0, left) : left + half]
            distance = np.hypot(column[window] - x, row[window] - y)
            cover = np.clip(size / 2 - distance + 0.5, 0, 1)[..., None]
            image[window] += cover * (np.asarray(self.bead_bgr, dtype=np.float32) - image[window])
        image = cv2.GaussianBlur(image, (0, 0), 0.6)
        random = np.random.default_rng(seed)
        noisy = image + self.noise * random.standard_normal(image.shape, dtype=np.float32)
        return np.asarray(np.clip(np.round(noisy), 0, 255), dtype=np.uint8)

    def sensor_toml(self) -> str:
        """The nominal description."""
        rings = ", ".join(f"{{theta_deg = {t}, count = {n}, phi0_deg = {p}}}" for t, n, p in self.rings)
        return (
            "[dome]\nouter_radius_mm = 30.0\nwall_mm = 5.0\n"
            f"[markers]\nradius_mm = 26.5\ndiameter_mm = 3.0\nrings = [{rings}]\n"
            f"[camera]\nwidth = {self.width}\nheight = {self.height}\n"
            f"matrix = [{self.focal_px}, {self.focal_px}, {self.width / 2}, {self.height / 2}]\n"
            "position_mm = [0.0, 0.0, -45.0]\nfps = 30\n"
        )

    def write(self, folder: Path, presses: int = 0, seed: int = 1) -> Path:
        """A press dataset: 5 reference frames, then presses in turn train, train, train, test; every tenth
        frame touches nothing."""
        for name in ("reference", "frames"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / "sensor.toml").write_text(self.sensor_toml())
        for number in range(5):
            image = self.picture(self.beads_mm(), seed=1000 * seed + number)
            _write(folder / "reference" / f"{number}.png", image)
        random = np.random.default_rng(seed)
        lines = [HEADER]
        for number in range(presses):
            theta, phi = random.uniform(0, math.radians(65)), random.uniform(-math.pi, math.pi)
            depth = 0.0 if number % 10 == 9 else random.uniform(0.4, 2.5)
            image = self.picture(self.pressed_mm(theta, phi, depth), seed=1000 * seed + 100 + number)
            _write(folder / "frames" / f"{number:03}.png", image)
            lines.append(_truth_row(number, theta, phi, depth))
        (folder / "truth.csv").write_text("".join(lines))
        return folder

    def _sizes_px(self, beads_mm: Array) -> Array:
        distance = np.linalg.norm(beads_mm - np.array([0.0, 0.0, -45.0]), axis=1)
        return np.asarray(self.focal_px * 3.0 / distance)


def _unit(theta_rad: float, phi_rad: float) -> Array:
    sin = math.sin(theta_rad)
    return np.array([sin * math.cos(phi_rad), sin * math.sin(phi_rad), math.cos(theta_rad)])


def _write(path: Path, image: NDArray[np.uint8]) -> None:
    assert cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])


def _truth_row(number: int, theta_rad: float, phi_rad: float, depth_mm: float) -> str:
    split = "test" if number % 4 == 3 else "train"
    start = f"{number:03}.png,{split},{number / 30:.4f}"
    if depth_mm == 0:
        return f"{start},,,,0,0,0,0,none,0\n"
    normal = _unit(theta_rad, phi_rad)
    force_N = STIFFNESS_N_MM * depth_mm
    place = ",".join(f"{30 * value:.4f}" for value in normal)
    force = ",".join(f"{-force_N * value:.5f}" for value in normal)
    return f"{start},{place},{force_N:.5f},{force},plate,0\n"


@pytest.fixture(scope="session")
def drawn_dome() -> DrawnDome:
    """The drawn sensor of 85 dark beads, 320x240."""
    return DrawnDome()


@pytest.fixture(scope="session")
def another_dome() -> Callable[..., DrawnDome]:
    """A drawn sensor with other fields: ``another_dome(bead_bgr=(250, 250, 250))``."""
    return lambda **fields: replace(DrawnDome(), **fields)


@pytest.fixture(scope="session")
def drawn_dataset(drawn_dome: DrawnDome, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A press dataset of the drawn sensor, 60 frames. Read only: copy it to change it."""
    return drawn_dome.write(tmp_path_factory.mktemp("drawn") / "dome", presses=60)


@pytest.fixture(scope="session")
def drawn_calibration(drawn_dataset: Path) -> Calibration:
    """Calibrated for the paper's method; the correction model has tests of its own."""
    return calibrate(read_dataset(drawn_dataset))


@pytest.fixture(scope="session")
def drawn_calibration_file(drawn_calibration: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The calibration of `drawn_dataset` as a file. Read only."""
    path = tmp_path_factory.mktemp("calibration") / "drawn.cal"
    save_calibration(drawn_calibration, path)
    return path


@pytest.fixture(scope="session")
def sample_calibration(
    shared_data: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory
) -> Calibration:
    """The recorded press sample's, with all its presses and the dome model that is shipped.

    One of pytest's workers calibrates for all of them.
    """
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID", "")
    folder = tmp_path_factory.getbasetemp().parent if run else tmp_path_factory.mktemp("sample")
    path = folder / f"sample-{run}.cal"
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            dataset = read_dataset(shared_data("press-sample"))
            save_calibration(calibrate(dataset, dome=load_dome_model()), path)
    return load_calibration(path)


@pytest.fixture(scope="session")
def real_time_demo(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """The folder of a demo that ran for 9 s as a user starts it, and what it printed."""
    folder = tmp_path_factory.mktemp("demo")
    command = [sys.executable, "-m", "palpate_host.cli.main", "demo", "--no-view", "--output", str(folder)]
    run = subprocess.run(
        [*command, "--duration", "9"], check=False, capture_output=True, text=True, timeout=300
    )
    return folder, run


@pytest.fixture
def made_fingertips(fingertips_of_the_demo: Path, tmp_path: Path) -> None:
    """A demo with tmp_path as its output finds its fingertips made, as the second demo of a person does."""
    shutil.copytree(fingertips_of_the_demo, tmp_path / "sensors")


@pytest.fixture(scope="session")
def fingertips_of_the_demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "sensors"
    command = [sys.executable, "-m", "palpate_host.cli.main", "simulate", "fingertips", "-o", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    return folder


@pytest.fixture
def host_refused(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs ``palpate-host ARGS`` in this process and gives the text of its refusal, its last line."""

    def run(*arguments: object) -> str:
        capfd.readouterr()
        monkeypatch.setattr(sys, "argv", ["palpate-host", *map(str, arguments)])
        with pytest.raises(SystemExit) as leaving:
            host_main()
        said = capfd.readouterr()
        assert leaving.value.code not in (0, None)
        assert "Traceback" not in said.err
        *_, last = said.err.splitlines()
        assert last.startswith("error: "), said.err
        assert said.err.count("error: ") == 1, said.err
        return last.removeprefix("error: ")

    return run


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where everything is installed (PALPATE_NO_SKIP=1, as in CI) a skipped test is a failed one."""
    report = yield
    if report.skipped and os.environ.get("PALPATE_NO_SKIP") == "1":
        report.outcome = "failed"
        report.longrepr = f"skipped where nothing may skip: {report.longrepr}"
    return report
