"""The calibration file: what is read is what was written, or it is refused."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate_edge.calibration.calibration_file import check_sensor, load_calibration, save_calibration
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.contact_fit.contact_fields import ContactFields
from palpate_edge.estimation.contact_fit.place_stiffness import PlaceStiffness
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed

ONE_FILE_A_TEST = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def one_line(error):
    text = str(error.value)
    assert "\n" not in text
    return text


def test_round_trip(drawn_calibration, tmp_path):
    save_calibration(drawn_calibration, tmp_path / "a.cal")
    read = load_calibration(tmp_path / "a.cal")
    assert msgspec.structs.replace(read, checksum="") == drawn_calibration
    assert [path.name for path in tmp_path.iterdir()] == ["a.cal"]


def test_contact_fields_are_read_back_and_a_file_without_them_is_one_of_an_earlier_version(
    drawn_calibration, tmp_path
):
    fields = ContactFields(*(packed(np.full((2, 3), 0.1 * n)) for n in range(4)), share=0.5, radius_scale=0.9)
    calibration = msgspec.structs.replace(drawn_calibration, contact_fields=fields)
    save_calibration(calibration, tmp_path / "a.cal")
    assert load_calibration(tmp_path / "a.cal").contact_fields == fields
    save_calibration(drawn_calibration, tmp_path / "b.cal")
    assert b"contact_fields" not in (tmp_path / "b.cal").read_bytes()
    assert load_calibration(tmp_path / "b.cal").contact_fields is msgspec.UNSET


def test_the_stiffness_by_place_is_read_back_and_a_file_without_it_is_one_of_an_earlier_version(
    drawn_calibration, tmp_path
):
    numbers = [packed(np.full(shape, 0.25)) for shape in ((5, 3), (3, 3), (5, 1), (1,))]
    slant = Expansion(numbers[1], *(packed(np.full(shape, 0.5)) for shape in ((5, 3), (3,))))
    stiffness = PlaceStiffness(numbers[0], Expansion(*numbers[1:]), slant)
    save_calibration(
        msgspec.structs.replace(drawn_calibration, place_stiffness=stiffness), tmp_path / "a.cal"
    )
    assert load_calibration(tmp_path / "a.cal").place_stiffness == stiffness
    save_calibration(drawn_calibration, tmp_path / "b.cal")
    assert b"place_stiffness" not in (tmp_path / "b.cal").read_bytes()
    assert load_calibration(tmp_path / "b.cal").place_stiffness is msgspec.UNSET
    before_slants = msgspec.structs.replace(stiffness, slant=msgspec.UNSET)
    save_calibration(
        msgspec.structs.replace(drawn_calibration, place_stiffness=before_slants), tmp_path / "c.cal"
    )
    assert b"slant" not in (tmp_path / "c.cal").read_bytes()
    assert load_calibration(tmp_path / "c.cal").place_stiffness == before_slants


def test_saving_again_gives_the_same_bytes(drawn_calibration, drawn_calibration_file, tmp_path):
    save_calibration(load_calibration(drawn_calibration_file), tmp_path / "b.cal")
    assert (tmp_path / "b.cal").read_bytes() == drawn_calibration_file.read_bytes()


@ONE_FILE_A_TEST
@given(data=st.data())
def test_any_changed_byte_is_refused(drawn_calibration_file, tmp_path, data):
    whole = drawn_calibration_file.read_bytes()
    at = data.draw(st.integers(0, len(whole) - 1))
    other = data.draw(st.integers(0, 255).filter(lambda value: value != whole[at]))
    changed = tmp_path / "changed.cal"
    changed.write_bytes(whole[:at] + bytes([other]) + whole[at + 1 :])
    with pytest.raises(CalibrationError, match="make it again with palpate-edge calibrate") as error:
        load_calibration(changed)
    assert str(changed) in one_line(error)


@ONE_FILE_A_TEST
@given(data=st.data())
def test_any_shorter_or_longer_file_is_refused(drawn_calibration_file, tmp_path, data):
    whole = drawn_calibration_file.read_bytes()
    end = data.draw(st.integers(0, len(whole) - 1))
    for spoilt in (whole[:end], whole + whole[:end] + b" "):
        (tmp_path / "spoilt.cal").write_bytes(spoilt)
        with pytest.raises(CalibrationError):
            load_calibration(tmp_path / "spoilt.cal")


@ONE_FILE_A_TEST
@given(st.binary(max_size=300))
def test_random_bytes_are_refused(tmp_path, data):
    (tmp_path / "noise.cal").write_bytes(data)
    with pytest.raises(CalibrationError) as error:
        load_calibration(tmp_path / "noise.cal")
    one_line(error)


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, '{"version": ' + "[" * 5000])
def test_hostile_json_is_refused(tmp_path, text):
    (tmp_path / "deep.cal").write_text(text)
    with pytest.raises(CalibrationError) as error:
        load_calibration(tmp_path / "deep.cal")
    one_line(error)


def test_a_missing_file_names_the_way_out(tmp_path):
    with pytest.raises(CalibrationError, match=r"none\.cal: no such file; make it with palpate-edge"):
        load_calibration(tmp_path / "none.cal")


def test_another_version_is_told(drawn_calibration, tmp_path):
    later = msgspec.structs.replace(drawn_calibration, version=drawn_calibration.version + 1)
    save_calibration(later, tmp_path / "later.cal")
    with pytest.raises(CalibrationError, match=rf"version {later.version}, this program reads"):
        load_calibration(tmp_path / "later.cal")


def test_a_file_that_cannot_be_written_leaves_nothing(drawn_calibration, tmp_path):
    (tmp_path / "taken").mkdir()
    for path in (tmp_path / "nowhere" / "a.cal", tmp_path / "taken"):
        with pytest.raises(CalibrationError, match="cannot be written"):
            save_calibration(drawn_calibration, path)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_failed_write_keeps_the_former_file(
    drawn_calibration, drawn_calibration_file, tmp_path, monkeypatch
):
    path = tmp_path / "kept.cal"
    path.write_bytes(drawn_calibration_file.read_bytes())

    def full_disk(_descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    with pytest.raises(CalibrationError, match="no space left on the disk"):
        save_calibration(msgspec.structs.replace(drawn_calibration, residual_px=9.0), path)
    assert path.read_bytes() == drawn_calibration_file.read_bytes()
    assert [found.name for found in tmp_path.iterdir()] == ["kept.cal"]


def test_another_sensor_is_refused_by_both_fingerprints(drawn_calibration, tmp_path):
    ours = drawn_calibration.sensor
    theirs = msgspec.structs.replace(ours, dome=msgspec.structs.replace(ours.dome, wall_mm=4.0))
    check_sensor(drawn_calibration.sensor, tmp_path / "a.cal", ours, tmp_path / "sensor.toml")
    with pytest.raises(CalibrationError) as error:
        check_sensor(drawn_calibration.sensor, tmp_path / "a.cal", theirs, tmp_path / "sensor.toml")
    text = one_line(error)
    assert all(word in text for word in (ours.fingerprint(), theirs.fingerprint(), "palpate-edge calibrate"))
