"""The daemon without a calibration, and recordings without a daemon and with one."""

from __future__ import annotations

import json
import struct

import pytest
from click.testing import CliRunner

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.cli.check import check
from palpate_edge.cli.record import record
from palpate_edge.common.errors import CalibrationError, CaptureError, ConfigError

EMCY, TPDO_2 = 0x090, 0x290
NO_CALIBRATION = 0xFF07


@pytest.fixture
def uncalibrated(tmp_path, drawn_dataset):
    """A configuration whose camera plays the drawn dataset, and whose calibration is not made yet."""
    config = tmp_path / "finger.toml"
    config.write_text(
        f'name = "bare"\nhealth = "{tmp_path / "bare.health"}"\n'
        f'[capture]\nsource = "recorded"\npath = "{drawn_dataset}"\n'
        '[estimator]\ncalibration = "finger.cal"\ncalibration_required = false\n'
        f'[node]\nid = 16\n[bus]\ninterface = "palpate"\nchannel = "{tmp_path / "hub.sock"}"\n'
    )
    return config


def test_frames_are_recorded_from_the_camera_without_daemon_and_calibration(uncalibrated, tmp_path):
    arguments = ["start", "--config", str(uncalibrated), "--frames", "3", "-o", str(tmp_path / "dome")]
    done = CliRunner().invoke(record, arguments, catch_exceptions=False)
    assert done.output.endswith(f"{tmp_path / 'dome'}: 3 frames\n")
    assert len(list((tmp_path / "dome").glob("*.png"))) == 3
    assert len((tmp_path / "dome" / "frames.csv").read_text().splitlines()) == 4
    with pytest.raises(CaptureError, match="has frames already"):
        CliRunner().invoke(record, arguments, catch_exceptions=False)
    with pytest.raises(CaptureError, match="no daemon of bare runs"):
        CliRunner().invoke(record, ["stop", "--config", str(uncalibrated)], catch_exceptions=False)


@pytest.mark.long
def test_check_shows_the_picture_and_warns_that_no_contact_is_valid(uncalibrated):
    done = CliRunner().invoke(check, ["--config", str(uncalibrated), "--json"])
    rows = {row["part"]: row for row in json.loads(done.output)}
    assert rows["camera"]["verdict"] == "ok"
    assert (
        rows["calibration"]["verdict"] == "warn" and "no contact is valid" in rows["calibration"]["way_out"]
    )
    assert "blobs, brightness" in rows["picture"]["value"]
    required = uncalibrated.read_text().replace("calibration_required = false\n", "")
    uncalibrated.write_text(required)
    done = CliRunner().invoke(check, ["--config", str(uncalibrated), "--json"])
    rows = {row["part"]: row for row in json.loads(done.output)}
    assert rows["calibration"]["verdict"] == "fail" and rows["camera"]["value"] == "not tried"


@pytest.mark.long
def test_the_daemon_publishes_the_picture_and_never_a_valid_contact(bare_rig):
    """It answers on the bus, says why there is no contact, and has the camera."""
    rig = bare_rig
    bus = rig.listen()
    bus.send([CanFrame(0x000, b"\x81\x10")])  # reset: it says again what is wrong
    assert struct.unpack_from("<H", rig.heard(bus, EMCY, lambda _: True))[0] == NO_CALIBRATION
    bus.send([CanFrame(0x000, b"\x01\x10")])
    for _ in range(30):
        assert rig.heard(bus, TPDO_2, lambda _: True)[6] == 0
    rig.until((rig.folder / "finger.health").exists)
    rig.until(lambda: json.loads((rig.folder / "finger.health").read_bytes())["picture"] is not None)
    health = json.loads((rig.folder / "finger.health").read_bytes())
    assert health["method"] == "none" and health["emergencies"] == ["no calibration"]
    assert health["picture"]["brightness"] > 0
    done = rig.edge("check")
    assert "warn   calibration  none" in done.stdout and "blobs, brightness" in done.stdout
    done = rig.edge("record", "start", "--frames", "3")
    assert done.returncode == ConfigError.exit_status and "has the camera (pid" in done.stderr
    assert rig.edge("record", "start").returncode == 0
    rig.until(lambda: len(list((rig.folder / "recordings").glob("*/*.png"))) > 3)


def test_a_calibration_that_is_required_is_an_error_as_before(uncalibrated):
    from palpate_edge.daemon.config import read_config
    from palpate_edge.daemon.estimator_factory import configured_calibration

    config = read_config(uncalibrated)
    assert configured_calibration(config) is None
    uncalibrated.write_text(uncalibrated.read_text().replace("calibration_required = false\n", ""))
    with pytest.raises(CalibrationError, match="no such file"):
        configured_calibration(read_config(uncalibrated))
    (uncalibrated.parent / "finger.cal").write_text("damaged")
    uncalibrated.write_text(uncalibrated.read_text() + "\n")
    with pytest.raises(CalibrationError):
        configured_calibration(config)


def test_without_a_parameter_file_1010h_is_0_and_a_save_names_the_key(bare_rig):
    rig = bare_rig
    rig.until((rig.folder / "finger.health").exists)
    bus = rig.listen()

    def answer(request):
        bus.send([CanFrame(0x610, bytes.fromhex(request))])
        return rig.heard(bus, 0x590, lambda data: data[1:4] == b"\x10\x10\x02" and data[0] in (0x43, 0x80))

    assert answer("4010100200000000") == bytes.fromhex("4310100200000000")
    bus.send([CanFrame(0x000, bytes([0x80, 0x10]))])
    assert answer("2310100273617665") == bytes.fromhex("8010100200000606")
    told = "a master wants to store parameters: set node.parameters"
    rig.until(lambda: told in (rig.folder / "stderr").read_text())
