"""The dome model's file: what is read is what was written, or it is refused in one line."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate_edge.calibration.training.dome_model import (
    NAMES,
    SHIPPED,
    TWISTED_NAMES,
    DomeModel,
    SolidPresses,
    TwistedPresses,
    load_dome_model,
    save_dome_model,
)
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.displacement_field import canonical_directions

ALL_NAMES = (*NAMES, *TWISTED_NAMES)
WIDTH = 2 * len(canonical_directions())
ONE_FILE_A_TEST = settings(
    deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def dome():
    rng = np.random.default_rng(1)
    return DomeModel(
        rng.uniform(-2, 2, (7, WIDTH)),
        rng.standard_normal((7, 3)),
        rng.standard_normal((7, 3)),
        26.5,
        TwistedPresses(rng.uniform(-2, 2, (5, WIDTH)), rng.standard_normal(5)),
    )


@pytest.fixture(scope="module")
def arrays(dome):
    return arrays_of(dome)


def arrays_of(dome):
    plain = {name: np.asarray(getattr(dome, name)) for name in NAMES}
    return plain | {"twisted_fields": dome.twisted.fields, "torsions": dome.twisted.torsions}


def refusal(path, one_line):
    with pytest.raises(CalibrationError) as error:
        load_dome_model(path)
    text = one_line(error)
    assert str(path) in text
    assert "palpate-edge train" in text
    return text


def written(path, arrays):
    with path.open("wb") as file:
        np.savez(file, **arrays)
    return path


def test_round_trip(dome, tmp_path):
    """Half precision keeps 11 bits: fields within 0.05 %, the others by single precision."""
    save_dome_model(dome, tmp_path / "dome.npz")
    read = load_dome_model(tmp_path / "dome.npz")
    assert read.fields == pytest.approx(dome.fields, rel=2**-11, abs=1e-6)
    assert read.directions == pytest.approx(dome.directions, rel=1e-6)
    assert read.forces == pytest.approx(dome.forces, rel=1e-6)
    assert read.twisted.fields == pytest.approx(dome.twisted.fields, rel=2**-11, abs=1e-6)
    assert read.twisted.torsions == pytest.approx(dome.twisted.torsions, rel=1e-6)
    assert read.markers_radius_mm == dome.markers_radius_mm
    assert {read.fields.dtype, read.forces.dtype} == {np.dtype(np.float64)}


def test_the_shipped_model_is_whole():
    dome = load_dome_model()
    count = len(dome.fields)
    assert count >= 1000
    assert np.linalg.norm(dome.directions, axis=1) == pytest.approx(1, abs=1e-6)
    pushing = -(dome.forces * dome.directions).sum(axis=1)
    assert (pushing > 0).all()  # a probe pushes, it never pulls
    assert len(dome.twisted.fields) >= 1000
    assert dome.twisted.torsions[::2] == pytest.approx(-dome.twisted.torsions[1::2])  # mirror images
    solid = dome.solid
    assert len(solid.motions) == len(solid.forces) == len(solid.torsions) >= 1400
    assert np.linalg.norm(solid.points, axis=1) == pytest.approx(1, abs=1e-6)
    assert (-(solid.forces * solid.directions).sum(axis=1) > 0).all()
    assert np.abs(solid.directions[:, 1]).max() == 0  # at azimuth 0
    assert SHIPPED.stat().st_size < 2_200_000


def test_a_file_without_twisted_presses_is_read(arrays, tmp_path):
    read = load_dome_model(written(tmp_path / "a.npz", {name: arrays[name] for name in NAMES}))
    assert read.twisted is None
    assert read.for_markers(53.0).twisted is None
    save_dome_model(read, tmp_path / "b.npz")
    assert load_dome_model(tmp_path / "b.npz").twisted is None


def test_presses_in_three_dimensions_are_kept_and_grow_with_the_dome(dome, tmp_path):
    random = np.random.default_rng(5)
    solid = SolidPresses(*(random.normal(size=shape) for shape in ((9, 3), (4, 9, 3), (4, 3), (4, 3), (4,))))
    save_dome_model(replace(dome, solid=solid), tmp_path / "solid.npz")
    read = load_dome_model(tmp_path / "solid.npz").solid
    assert read.motions == pytest.approx(solid.motions, abs=2e-3 * np.abs(solid.motions).max())
    assert read.points == pytest.approx(solid.points, rel=1e-6)
    assert read.directions == pytest.approx(solid.directions, rel=1e-6)
    larger = replace(dome, solid=solid).for_markers(2 * dome.markers_radius_mm).solid
    assert larger.motions == pytest.approx(2 * solid.motions)
    assert larger.forces == pytest.approx(4 * solid.forces)
    assert larger.torsions == pytest.approx(8 * solid.torsions)
    assert (larger.directions == solid.directions).all()


@pytest.mark.parametrize(
    ("modes", "amounts"), [((4, 8, 3), (4, 4)), ((3, 9, 3), (4, 4)), ((4, 9, 3), (3, 4))]
)
def test_presses_in_three_dimensions_of_another_shape_are_refused(arrays, tmp_path, one_line, modes, amounts):
    solid = {"points": (9, 3), "modes": modes, "amounts": amounts, "solid_directions": (4, 3)}
    solid |= {"solid_forces": (4, 3), "solid_torsions": (4,)}
    path = written(tmp_path / "a.npz", arrays | {name: np.ones(size) for name, size in solid.items()})
    assert "another version" in refusal(path, one_line)


def test_an_array_of_an_earlier_version_is_left_out(dome, arrays, tmp_path):
    """The shipped file has one as well: how much each press's hidden beads left open."""
    read = load_dome_model(written(tmp_path / "a.npz", arrays | {"hidden": np.zeros(7)}))
    assert (read.fields == dome.fields).all()


def test_another_size_of_dome(dome):
    """A body of twice the size and one silicone: motions double, forces (stress times area) quadruple, their
    moments are eight times as large."""
    double = dome.for_markers(53.0)
    assert (double.fields == 2 * dome.fields).all()
    assert (double.forces == 4 * dome.forces).all()
    assert (double.directions == dome.directions).all()
    assert (double.twisted.fields == 2 * dome.twisted.fields).all()
    assert (double.twisted.torsions == 8 * dome.twisted.torsions).all()
    assert double.markers_radius_mm == 53.0


@pytest.mark.parametrize(
    ("name", "spoilt"),
    [
        ("fields", np.zeros((7, WIDTH - 2))),
        ("fields", np.zeros(7)),
        ("directions", np.zeros((6, 3))),
        ("forces", np.zeros((3, 3))),
        ("forces", np.zeros((7, 1))),
        ("torsions", np.zeros(6)),
        ("twisted_fields", np.zeros((5, WIDTH + 1))),
        ("markers_radius_mm", np.ones(3)),
    ],
    ids=lambda value: value if isinstance(value, str) else str(np.shape(value)),
)
def test_wrong_shapes_are_refused(arrays, tmp_path, one_line, name, spoilt):
    assert "another version" in refusal(written(tmp_path / "a.npz", arrays | {name: spoilt}), one_line)


@pytest.mark.parametrize("name", ALL_NAMES)
def test_numbers_that_are_none_are_refused(arrays, tmp_path, one_line, name):
    for value in (np.nan, np.inf):
        spoilt = np.array(arrays[name])
        spoilt.flat[0] = value
        refusal(written(tmp_path / "a.npz", arrays | {name: spoilt}), one_line)


def test_no_presses_and_no_size_are_refused(arrays, tmp_path, one_line):
    empty = {name: array[:0] if array.ndim else array for name, array in arrays.items()}
    refusal(written(tmp_path / "a.npz", empty), one_line)
    refusal(written(tmp_path / "b.npz", arrays | {"markers_radius_mm": np.float64(0)}), one_line)


@pytest.mark.parametrize("name", ALL_NAMES)
def test_a_missing_array_is_named(arrays, tmp_path, one_line, name):
    rest = {key: array for key, array in arrays.items() if key != name}
    assert name in refusal(written(tmp_path / "a.npz", rest), one_line)


def test_what_is_no_dome_model_is_refused(arrays, tmp_path, one_line):
    path, one_array = tmp_path / "a.npz", io.BytesIO()
    np.save(one_array, arrays["fields"])
    objects = io.BytesIO()
    np.savez(objects, **(arrays | {"forces": np.array([object()])}))
    for data in (b"", one_array.getvalue(), objects.getvalue(), b"PK\x05\x06" + bytes(18)):
        path.write_bytes(data)
        refusal(path, one_line)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("fields.npy", b"no array")
    refusal(path, one_line)
    refusal(written(path, arrays | {"fields": np.full((7, WIDTH), "x")}), one_line)


@ONE_FILE_A_TEST
@given(data=st.data())
def test_changed_bytes_are_refused_or_do_not_matter(dome, tmp_path, one_line, data):
    """A zip archive has a checksum for what it holds and none for its own bookkeeping (times, attributes)."""
    path = tmp_path / "dome.npz"
    save_dome_model(dome, path)
    whole = path.read_bytes()
    before = load_dome_model(path)
    at = data.draw(st.integers(0, len(whole) - 1))
    path.write_bytes(whole[:at] + data.draw(st.binary(min_size=1, max_size=4)) + whole[at + 1 :])
    try:
        after = load_dome_model(path)
    except CalibrationError:
        refusal(path, one_line)
    else:
        assert arrays_of(after).keys() == arrays_of(before).keys()
        assert all(np.array_equal(array, arrays_of(before)[name]) for name, array in arrays_of(after).items())


@ONE_FILE_A_TEST
@given(noise=st.binary(max_size=300))
def test_random_bytes_are_refused(tmp_path, one_line, noise):
    (tmp_path / "noise.npz").write_bytes(noise)
    refusal(tmp_path / "noise.npz", one_line)


def test_a_missing_file_and_a_folder_are_named(tmp_path, one_line):
    assert "is missing" in refusal(tmp_path / "none.npz", one_line)
    refusal(tmp_path, one_line)


def test_a_place_that_cannot_be_written_is_named(dome, tmp_path, one_line):
    for path in (tmp_path / "nowhere" / "dome.npz", tmp_path):
        with pytest.raises(CalibrationError, match="cannot be written") as error:
            save_dome_model(dome, path)
        assert str(path) in one_line(error)


def test_mirror_images_are_left_out_of_a_file_and_put_back(tmp_path):
    dome = load_dome_model()
    save_dome_model(dome, tmp_path / "pairs.npz")
    with np.load(tmp_path / "pairs.npz") as file:
        assert len(file["fields"]) == len(file["directions"]) == len(file["forces"]) == len(dome.fields) // 2
        assert len(file["torsions"]) == len(dome.twisted.fields) // 2
    read = load_dome_model(tmp_path / "pairs.npz")
    assert read.fields == pytest.approx(dome.fields, rel=1e-3, abs=1e-6)
    assert read.directions == pytest.approx(dome.directions)
    assert read.forces == pytest.approx(dome.forces)
    assert read.twisted.fields == pytest.approx(dome.twisted.fields, rel=1e-3, abs=1e-6)
    assert read.twisted.torsions == pytest.approx(dome.twisted.torsions)


def test_presses_without_their_mirror_images_are_kept_as_they_are(dome, tmp_path):
    single = replace(dome, fields=dome.fields[::2], directions=dome.directions[::2], forces=dome.forces[::2])
    save_dome_model(single, tmp_path / "single.npz")
    read = load_dome_model(tmp_path / "single.npz")
    assert read.forces == pytest.approx(single.forces)
    assert read.twisted.torsions == pytest.approx(dome.twisted.torsions)
