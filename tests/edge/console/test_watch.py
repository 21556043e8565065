"""``palpate-edge watch`` as a process, over real HTTP: beside a daemon, and with the camera of its own."""

from __future__ import annotations

import base64
import json
import signal
import stat
import subprocess
import sys

import cv2
import numpy as np
import pytest
from tests.edge.console.finger_toml import recorded_finger_toml


@pytest.fixture
def watch(rig, start_watch):
    """A console beside a daemon, with one client."""
    rig.until((rig.folder / "finger.watch").exists)
    watch = start_watch(rig.config)
    watch.look()
    watch.until(lambda: {"frame", "health"} <= watch.newest.keys(), "no frames")
    return watch


def picture_of(event):
    data = np.frombuffer(base64.b64decode(event["jpeg"]), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)


def test_pictures_and_commands_beside_a_daemon(rig, watch, drawn_dataset):
    check_the_picture(watch, drawn_dataset)
    check_the_commands(rig, watch)
    check_that_pictures_leave_the_daemon_only_while_somebody_looks(rig, watch)


def check_the_picture(watch, drawn_dataset):
    watch.until(lambda: watch.counts.get("frame", 0) >= 3, "no frames")
    frame = watch.newest["frame"]
    shown = picture_of(frame).astype(float)[8:]  # the camera writes noise into the first rows
    names = sorted((drawn_dataset / "frames").glob("*.png"))
    image = cv2.imread(str(names[frame["contact"]["sequence"] % len(names)]), cv2.IMREAD_GRAYSCALE)
    others = [cv2.imread(str(name), cv2.IMREAD_GRAYSCALE) for name in names]
    away = [np.abs(shown - other[8:]).mean() for other in others]
    assert np.abs(shown - image[8:]).mean() == min(away)
    beads = frame["beads"]
    assert len(beads["position_px"]) == len(beads["rest_px"]) == frame["contact"]["beads_expected"] == 85
    assert watch.newest["fingertip"]["outer_radius_mm"] == 30.0
    parts = {row["part"]: row["verdict"] for row in watch.newest["health"]["rows"]}
    assert parts["bus"] == parts["calibration"] == "ok"
    assert {"camera", "beads", "clock", "temperature"} <= parts.keys()  # a loaded machine drops frames


def check_that_pictures_leave_the_daemon_only_while_somebody_looks(rig, watch):
    ring = rig.folder / "finger.pictures"
    watch.until(lambda: watch.counts.get("frame", 0) >= 1, "no frames")
    assert stat.S_IMODE(ring.stat().st_mode) == 0o600
    assert stat.S_IMODE((rig.folder / "finger.watch").stat().st_mode) == 0o600
    assert stat.S_IMODE((rig.folder / "finger.token").stat().st_mode) == 0o600
    watch.look_away()
    watch.until(lambda: not ring.exists(), "the ring stays")
    watch.look()
    before = watch.counts["frame"]
    watch.until(lambda: watch.counts["frame"] > before + 1, "no more frames")


def check_the_commands(rig, watch):
    watch.until(lambda: watch.counts.get("frame", 0) >= 1, "no frames")
    assert watch.command("record", token="wrong")[0] == 401
    assert watch.command("record") == (200, f"recording under {rig.folder / 'recordings'}")
    watch.until(lambda: watch.newest["health"]["recording"], "no recording")
    assert watch.command("record_no_more")[0] == 200
    watch.until(lambda: not watch.newest["health"]["recording"], "recording goes on")
    assert list((rig.folder / "recordings").glob("*/frames.csv"))
    status, text = watch.command("snapshot")
    assert status == 200
    picture = cv2.imread(text.removeprefix("snapshot "), cv2.IMREAD_UNCHANGED)
    assert picture.shape == (240, 320)
    check_the_rate_of_tares(watch)
    assert watch.command("light", level=9) == (409, "no LED ring: set illumination.i2c_bus to its I2C bus")
    assert watch.command("identify")[0] == 409
    for values in ({"level": 300}, {"level": "x"}, {"other": 1}):
        assert watch.command("light", **values)[0] == 409
    known = "snapshot, record, record_no_more, tare, light, identify, guide"
    assert watch.command("pictures") == (409, f"unknown command; known: {known}")


def check_the_rate_of_tares(watch):
    """As on the bus (docs/bus.md): 44 at once, then one in 1 s."""
    answers = []
    while not answers or (answers[-1][0] == 200 and len(answers) < 300):
        answers.append(watch.command("tare"))
    *accepted, last = answers
    assert last == (409, "too many tares: wait a second")
    assert len(accepted) >= 44
    assert set(accepted) == {(200, "tare: the next frames are the untouched skin")}


def test_a_daemon_that_hangs_or_dies_is_shown_and_a_new_one_is_found(rig, watch):
    rig.process.send_signal(signal.SIGSTOP)
    watch.until(lambda: "does not answer" in watch.newest["state"]["text"], "not shown")
    rig.process.send_signal(signal.SIGCONT)
    watch.until(lambda: watch.newest["state"]["connected"], "not shown")
    rig.process.kill()
    rig.process.wait()
    watch.until(lambda: not watch.newest["state"]["connected"], "not shown")
    assert "has ended" in watch.newest["state"]["text"] or "no daemon" in watch.newest["state"]["text"]
    watch.until(lambda: "no daemon" in watch.newest["state"]["text"], "not shown")
    assert watch.command("tare") == (409, "no daemon of finger runs: start it first")
    before = watch.counts["frame"]
    command = [sys.executable, "-m", "palpate_edge.cli.main", "run", "--config", str(rig.config)]
    again = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        watch.until(lambda: watch.counts["frame"] > before, "no frames of the new daemon")
        assert watch.newest["state"] == {"connected": True, "text": "live, from the daemon"}
    finally:
        again.terminate()
        again.wait()


def test_a_daemon_without_calibration_shows_pictures_with_blobs(bare_rig, start_watch):
    bare_rig.until((bare_rig.folder / "finger.watch").exists)
    watch = start_watch(bare_rig.config)
    watch.look()
    watch.until(lambda: {"frame", "health"} <= watch.newest.keys(), "no frames")
    frame = watch.newest["frame"]
    assert not frame["contact"]["valid"]
    assert 70 <= len(frame["beads"]["position_px"]) <= 95
    assert watch.command("tare")[0] == 409
    assert "no calibration" in json.dumps(watch.newest["health"]["rows"])


def test_without_a_daemon_the_console_takes_the_camera(
    tmp_path, drawn_dataset, drawn_calibration_file, start_watch
):
    config = tmp_path / "finger.toml"
    config.write_text(
        f'name = "alone"\nhealth = "{tmp_path / "alone.health"}"\n'
        f'[capture]\nsource = "recorded"\npath = "{drawn_dataset}"\nloop = true\n'
        f'[estimator]\ncalibration = "{drawn_calibration_file}"\n'
        f'[node]\nid = 16\n[bus]\ninterface = "palpate"\nchannel = "{tmp_path / "no-hub.sock"}"\n'
    )
    watch = start_watch(config)
    assert watch.lines[0] == "alone: no daemon runs; this console takes the camera, without the bus"
    watch.look()
    watch.until(lambda: watch.counts.get("frame", 0) >= 3, "no frames")
    assert len(watch.newest["frame"]["beads"]["position_px"]) == 85
    assert watch.command("record")[0] == 200
    watch.until(lambda: list((tmp_path / "recordings").glob("*/*.png")), "no images")
    watch.until(lambda: watch.newest["health"]["recording"], "no recording")
    assert watch.command("record_no_more")[0] == 200
    watch.until(lambda: not watch.newest["health"]["recording"], "recording goes on")
    assert watch.command("snapshot")[0] == 200
    check_the_rate_of_tares(watch)
    parts = {row["part"]: row["verdict"] for row in watch.newest["health"]["rows"]}
    assert parts["bus"] == "absent" and "camera" in parts


def test_a_recording_that_ends_is_shown(tmp_path, drawn_dataset, start_watch):
    config = recorded_finger_toml(tmp_path, drawn_dataset / "reference", "short", loop=False)
    watch = start_watch(config)
    watch.look()
    ended = {"connected": False, "text": "the recording has ended"}
    watch.until(lambda: watch.newest.get("state") == ended, "not shown")
