"""`palpate-host simulate camera` as a process, read by the capture source and estimator of palpate_edge."""

from __future__ import annotations

import csv
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import save_calibration
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.capture import shared_memory
from palpate_edge.capture.shared_memory import SharedMemorySource
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.estimator import Estimator
from palpate_twin.cli.simulate import simulate

PATIENCE_S = 150  # timeout on a loaded machine


@pytest.fixture(scope="module")
def sensor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("live") / "dome"
    options = ["-o", str(folder), "--random-seed", "15", "--presses", "12", "--test-presses", "0"]
    assert CliRunner().invoke(simulate, ["dataset", *options], catch_exceptions=False).exit_code == 0
    return folder


def _camera(sensor: Path, ring: Path, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "palpate_host.cli.main", "simulate", "camera", "--sensor", str(sensor)]
    process = subprocess.Popen(
        [*command, "--shm", str(ring), *options], stderr=subprocess.PIPE, text=True, stdout=subprocess.DEVNULL
    )
    deadline_s = time.monotonic() + PATIENCE_S
    while not ring.exists():
        assert process.poll() is None
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    return process


@pytest.mark.slow
def test_live_contacts_are_where_the_camera_says_something_presses(
    sensor: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared_memory, "STALLED_AFTER_S", PATIENCE_S)
    calibration = calibrate(read_dataset(sensor), dome=load_dome_model())
    ring, truth = tmp_path / "ring", tmp_path / "truth.csv"
    process = _camera(sensor, ring, "--truth", str(truth), "--seconds", "600")
    source = SharedMemorySource(ring, calibration.sensor, lambda stamp_us: stamp_us)
    estimator = Estimator(calibration)
    begin_us = time.monotonic_ns() // 1000
    contacts = {}
    while len(contacts) < 150:
        frame = source.read()
        assert frame is not None
        contacts[frame.sequence] = estimator.estimate(frame)
        assert -1e6 < frame.exposed_at_us - begin_us < 1e6 * PATIENCE_S
    source.close()
    process.send_signal(signal.SIGTERM)
    _, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "camera stopped" in stderr
    assert not ring.exists()

    with truth.open(newline="") as file:
        rows = {int(row["sequence"]): row for row in csv.DictReader(file)}
    firm = [
        (contact, rows[sequence])
        for sequence, contact in contacts.items()
        if rows[sequence]["x_mm"] and abs(float(rows[sequence]["fz_N"])) > 0.2
    ]
    assert len(firm) > 30
    given = [contact for contact, _ in firm if contact.position_mm is not None]
    assert len(given) > 0.8 * len(firm)
    errors_mm = [
        np.linalg.norm(
            np.array(contact.position_mm) - [float(row[axis]) for axis in ("x_mm", "y_mm", "z_mm")]
        )
        for contact, row in firm
        if contact.position_mm is not None
    ]
    assert np.median(errors_mm) < 1.0
    untouched = [contacts[s] for s in contacts if not rows[s]["x_mm"]]
    assert untouched
    assert np.mean([contact.position_mm is None for contact in untouched]) > 0.9


def test_the_camera_stops_by_itself_and_refuses_what_it_cannot_do(sensor: Path, tmp_path: Path) -> None:
    process = _camera(sensor, tmp_path / "ring", "--seconds", "1")
    _, stderr = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
    assert "exposures skipped" in stderr
    command = [sys.executable, "-m", "palpate_host.cli.main", "simulate", "camera", "--shm", "/nowhere/ring"]
    failed = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert failed.returncode == 5
    assert failed.stderr.startswith("camera of 85 beads")
    assert "error: /nowhere/ring cannot be written: its folder does not exist" in failed.stderr


@pytest.mark.slow
def test_a_daemon_puts_live_contacts_on_the_bus(sensor: Path, tmp_path: Path) -> None:
    """Camera, hub and `palpate-edge run` run as processes; TPDO 1 has points of the dome's outer sphere."""
    calibration, ring, socket = tmp_path / "dome.cal", tmp_path / "ring", tmp_path / "hub.sock"
    found = calibrate(read_dataset(sensor), dome=load_dome_model())
    save_calibration(found, calibration)
    config = tmp_path / "finger.toml"
    config.write_text(
        f'name = "finger"\n[capture]\nsource = "shared_memory"\npath = "{ring}"\n'
        f'[estimator]\ncalibration = "{calibration}"\n[node]\nid = 16\n'
        f'[bus]\ninterface = "palpate"\nchannel = "{socket}"\n'
    )
    hub = subprocess.Popen(
        [sys.executable, "-m", "palpate_host.cli.main", "bus", "hub", "--socket", str(socket)],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert hub.stderr is not None
    assert "listening" in hub.stderr.readline()
    processes = [
        hub,
        subprocess.Popen([sys.executable, "-m", "palpate_edge.cli.main", "run", "--config", str(config)]),
    ]
    places: list[NDArray[np.float64]] = []
    try:
        with open_bus(BusConfig(interface="palpate", channel=str(socket)), "test", [0x190]) as bus:
            for _ in range(
                2
            ):  # the second camera comes while the daemon waits for the first, which was killed
                processes.append(_camera(sensor, ring))
                places += _some_places(bus, 20)
                processes[-1].kill()
                ring.unlink()
    finally:
        for process in reversed(processes):
            process.terminate()
            process.communicate(timeout=PATIENCE_S)
    assert len(places) >= 40
    radius_mm = found.sensor.dome.outer_radius_mm
    assert np.linalg.norm(places, axis=1) == pytest.approx(radius_mm, abs=0.1)


def _some_places(bus: Bus, count: int) -> list[NDArray[np.float64]]:
    """Return `count` positions of TPDO 1 in mm, ignoring frames that were sent before the call."""
    places: list[NDArray[np.float64]] = []
    bus.receive(0)
    deadline_s = time.monotonic() + PATIENCE_S
    while len(places) < count and time.monotonic() < deadline_s:
        bus.send([CanFrame(0x000, bytes([0x01, 16]))])  # NMT start, until the node is there
        for _, frame in bus.receive(0.5):
            place = np.array(struct.unpack("<3h", frame.data[:6])) / 100
            if place.any():
                places.append(place)
    return places
