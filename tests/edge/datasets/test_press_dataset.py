"""The press dataset's files: valid ones are read as written, all others are refused in one line."""

from __future__ import annotations

import math
import shutil

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.press_dataset import COLUMNS, Press, read_dataset, read_truth
from palpate_edge.datasets.sensor_file import read_sensor

FILES = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
HEADER = "frame,split,t_s,x_mm,y_mm,z_mm,fn_N,fx_N,fy_N,fz_N,probe,lost"
GOOD = "a.jpg,train,0.5,1.5,-2,29.9,1.25,0.1,0.2,-1.2,plate,3"


def truth(tmp_path, *rows, header=HEADER):
    path = tmp_path / "truth.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def refusal(call, path):
    with pytest.raises(DatasetError) as error:
        call(path)
    text = str(error.value)
    assert "\n" not in text
    assert str(path) in text
    return text


def test_a_row_is_read_as_written(tmp_path):
    rows = read_truth(truth(tmp_path, GOOD, "b.jpg,test,0.6,,,,0,0,0,0,none,0"))
    assert rows[0] == Press("a.jpg", "train", 0.5, (1.5, -2.0, 29.9), 1.25, (0.1, 0.2, -1.2), "plate", 3)
    assert rows[1] == Press("b.jpg", "test", 0.6, None, 0.0, (0.0, 0.0, 0.0), "none", 0, 0.0)


def test_the_torsion_is_an_optional_last_column(tmp_path):
    header = f"{HEADER},torsion_Nmm"
    rows = read_truth(truth(tmp_path, f"{GOOD},-4.5", "b.jpg,test,0.6,,,,0,0,0,0,none,0,", header=header))
    assert [row.torsion_Nmm for row in rows] == [-4.5, 0.0]
    for cell in ("", "0", "-0.0"):
        assert read_truth(truth(tmp_path, f"{GOOD},{cell}", header=header))[0].torsion_Nmm is None
    said = refusal(read_truth, truth(tmp_path, f"{GOOD},1", f"{GOOD},", header=header))
    assert "line 3: torsion_Nmm is blank, but 1 other contacts have a torsion" in said
    said = refusal(read_truth, truth(tmp_path, f"{GOOD},big", header=header))
    assert 'line 2: torsion_Nmm = "big" is not a finite number' in said
    assert "line 2 has 12 fields, not 13" in refusal(read_truth, truth(tmp_path, GOOD, header=header))


def test_pose_labels_may_stand_beside_the_columns(tmp_path):
    header = HEADER.replace("x_mm", "depth_mm,x_mm") + ",torsion_Nmm,tilt_x_deg"
    row = GOOD.replace("0.5,1.5", "0.5,0.75,1.5")
    (press,) = read_truth(truth(tmp_path, f"{row},-4.5,3", header=header))
    assert press == Press(
        "a.jpg", "train", 0.5, (1.5, -2.0, 29.9), 1.25, (0.1, 0.2, -1.2), "plate", 3, torsion_Nmm=-4.5
    )
    said = refusal(read_truth, truth(tmp_path, header=f"{HEADER},depth"))
    assert "further columns may be depth_mm, tilt_x_deg" in said


@pytest.mark.parametrize("force", [",,,", "0,0,0,0", "0.0,0,-0.0,0e3"])
def test_a_contact_without_newtons_has_an_unknown_force(tmp_path, force):
    contact, free = f"a.jpg,train,0,1,2,29,{force},plate,0", f"b.jpg,train,0,,,,{force},none,0"
    rows = read_truth(truth(tmp_path, contact, free))
    assert (rows[0].position_mm, rows[0].normal_force_N, rows[0].force_N) == ((1.0, 2.0, 29.0), None, None)
    assert (rows[1].position_mm, rows[1].normal_force_N, rows[1].force_N) == (None, 0.0, (0.0, 0.0, 0.0))


def test_a_contact_of_no_force_among_others_weighs_nothing(tmp_path):
    rows = read_truth(truth(tmp_path, GOOD, "b.jpg,train,0,1,2,29,0,0,0,0,plate,0"))
    assert [row.normal_force_N for row in rows] == [1.25, 0.0]


def test_forces_of_some_contacts_alone_are_refused(tmp_path):
    said = refusal(read_truth, truth(tmp_path, GOOD, "b.jpg,train,0,1,2,29,,,,,plate,0"))
    assert "line 3: fn_N, fx_N, fy_N, fz_N are blank, but 1 other contacts have a force" in said


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("a.jpg,train,0.5,1.5,-2", "line 3 has 5 fields, not 12"),
        (GOOD.replace("1.25", "much"), 'line 3: fn_N = "much" is not a finite number'),
        (GOOD.replace("1.25", "nan"), 'line 3: fn_N = "nan" is not a finite number'),
        (GOOD.replace("1.25", "inf"), 'line 3: fn_N = "inf" is not a finite number'),
        (GOOD.replace("29.9", "1e300"), 'line 3: z_mm = "1e300" is out of range: it must be -1000 to 1000'),
        (GOOD.replace("1.25", "1e300"), 'line 3: fn_N = "1e300" is out of range: it must be -10000 to 10000'),
        (GOOD.replace("1.5,-2,29.9", "0,0,0"), "line 3: x_mm, y_mm, z_mm = 0, 0, 0 is the dome's centre"),
        (GOOD.replace("1.5", ""), 'line 3: x_mm = "" is not a finite number'),
        (GOOD.replace("29.9", ""), 'line 3: z_mm = "" is not a finite number'),
        (GOOD.replace("a.jpg", "../../etc/a.jpg"), 'line 3: frame = "../../etc/a.jpg" is not a file name'),
        (GOOD.replace("a.jpg", ".."), 'line 3: frame = ".." is not a file name'),
        (GOOD.replace("a.jpg", ""), 'line 3: frame = "" is not a file name'),
        (GOOD.replace("a.jpg", "a\0b.jpg"), "is not a file name"),
        (GOOD.replace("train", "trial"), 'line 3: split = "trial" is not one of train, test'),
    ],
)
def test_a_bad_cell_is_named_with_its_line(tmp_path, row, said):
    assert said in refusal(read_truth, truth(tmp_path, GOOD, row))


def test_another_header_is_refused(tmp_path):
    assert HEADER in refusal(read_truth, truth(tmp_path, GOOD, header=HEADER.replace("fn_N", "fn")))


@FILES
@given(st.binary(max_size=400))
@example(b"")
@example((HEADER + "\n" + GOOD.replace("a.jpg", '"' + 200_000 * "a")).encode())
@example((HEADER + "\rgarbled\r\n\x00").encode())
@example(b"\xff\xfe" + HEADER.encode("utf-16-le"))
def test_random_bytes_as_truth_are_refused_or_empty(tmp_path, data):
    path = tmp_path / "truth.csv"
    path.write_bytes(data)
    try:
        read_truth(path)
    except DatasetError as error:
        assert "\n" not in str(error)


cells = st.one_of(
    st.text(max_size=8),
    st.sampled_from(["", "a.jpg", "train", "test", "0", "1e999", "-1.5", "nan", "plate", "1_0", "٣"]),
)


@FILES
@given(st.lists(st.lists(cells, min_size=len(COLUMNS), max_size=len(COLUMNS)).map(",".join), max_size=4))
def test_random_rows_are_refused_or_finite(tmp_path, rows):
    path = tmp_path / "truth.csv"
    path.write_bytes("\n".join([HEADER, *rows]).encode(errors="surrogatepass"))
    try:
        presses = read_truth(path)
    except DatasetError as error:
        assert "\n" not in str(error)
        return
    for press in presses:
        force = () if press.force_N is None else (press.normal_force_N, *press.force_N)
        values = (press.time_s, *force, *(press.position_mm or ()))
        assert all(math.isfinite(value) for value in values)
        assert press.split in {"train", "test"}
        assert "/" not in press.frame


@FILES
@given(
    st.one_of(st.binary(max_size=300), st.text(max_size=300).map(lambda text: text.encode(errors="ignore")))
)
@example(b"a = " + b"[" * 5000)
@example(b"a = " + b"9" * 5000)
@example(b"[dome]\nouter_radius_mm = 1979-13-45")
def test_random_text_as_sensor_toml_is_refused(tmp_path, data):
    path = tmp_path / "sensor.toml"
    path.write_bytes(data)
    refusal(read_sensor, path)


numbers = st.one_of(st.floats(), st.integers(-(10**6), 10**6), st.sampled_from([0, -1, 1e308, 5e-324]))


def toml(value):
    return repr(value)  # Python writes inf, -inf and nan as TOML does


@FILES
@given(
    key=st.sampled_from(
        [
            "outer_radius_mm = 30.0",
            "wall_mm = 5.0",
            "radius_mm = 26.5",
            "diameter_mm = 3.0",
            "theta_deg = 15",
            "count = 6",
            "phi0_deg = 7.5",
            "width = 320",
            "height = 240",
            "fps = 30",
        ]
    ),
    value=numbers,
)
def test_a_sensor_with_any_number_anywhere_is_refused_or_finite(drawn_dome, tmp_path, key, value):
    text = drawn_dome.sensor_toml()
    assert key in text
    path = tmp_path / "sensor.toml"
    path.write_text(text.replace(key, f"{key.split(' ')[0]} = {toml(value)}", 1))
    try:
        sensor = read_sensor(path)
    except DatasetError as error:
        assert "\n" not in str(error)
        return
    numbers_read = (sensor.dome.outer_radius_mm, sensor.dome.wall_mm, sensor.markers.radius_mm)
    rings = [value for ring in sensor.markers.rings for value in (ring.theta_deg, ring.phi0_deg)]
    assert all(math.isfinite(value) for value in (*numbers_read, *rings, sensor.camera.fps))
    assert 0 < sensor.dome.wall_mm < sensor.dome.outer_radius_mm


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("wall_mm = 5.0", "wall_mm = 31.0", "dome.wall_mm = 31.0 is out of range: it must be above 0, below"),
        ("wall_mm = 5.0", "", "wall_mm"),
        ("width = 320", "width = 3.5", "camera.width"),
        ("width = 320", "width = 4", "camera.width = 4 is out of range: it must be 16 to 8192"),
        ("[190.0, 190.0", "[nan, 190.0", "camera.matrix[0] = nan is not a number"),
        ("[190.0, 190.0", "[190.0", "camera.matrix"),
        ("-45.0]", "inf]", "camera.position_mm = [0.0, 0.0, inf] is out of range: it must be finite"),
        ("theta_deg = 0, count = 1", "theta_deg = 0, count = 2", "beads of markers.rings are 0.00 mm apart"),
        ("count = 6", "count = 0", "markers.rings[1].count = 0 is out of range: it must be 1 to 1000"),
        (
            "radius_mm = 26.5",
            "radius_mm = 26.5\ncount = 84",
            "markers.count = 84 is out of range: it must be 85",
        ),
        ("radius_mm = 26.5", 'radius_mm = 26.5\nlayout = "square"', "markers.layout"),
        ("count = 6", "count = 1000000000", "count = 1000000000 is out of range: it must be 1 to 1000"),
        (
            "fps = 30",
            "fps = 30\ndistortion = [0.0]",
            "camera.distortion = [0.0] is out of range: it must be 4 or 5 or 8 finite",
        ),
        ("fps = 30", 'fps = 30\nmodel = "plenoptic"', "camera.model"),
    ],
)
def test_a_bad_key_of_sensor_toml_is_named(drawn_dome, tmp_path, old, new, said):
    path = tmp_path / "sensor.toml"
    path.write_text(drawn_dome.sensor_toml().replace(old, new, 1))
    assert said in refusal(read_sensor, path)


def test_a_dataset_is_read(drawn_dataset):
    dataset = read_dataset(drawn_dataset)
    assert len(dataset.reference) == 5
    assert len(dataset.presses) == len(dataset.split("train")) + len(dataset.split("test")) == 60
    assert all(dataset.path(press).is_file() for press in dataset.presses)


def test_a_recording_without_truth_has_no_presses(drawn_dataset, tmp_path):
    shutil.copytree(drawn_dataset, tmp_path / "d", ignore=shutil.ignore_patterns("truth.csv", "frames"))
    assert read_dataset(tmp_path / "d").presses == ()


def test_what_is_missing_is_named(drawn_dataset, tmp_path):
    assert "give a press dataset's folder" in refusal(read_dataset, tmp_path / "none")
    shutil.copytree(drawn_dataset, tmp_path / "d", ignore=shutil.ignore_patterns("*.png"))
    with pytest.raises(DatasetError, match="reference has no image"):
        read_dataset(tmp_path / "d")
    (tmp_path / "d" / "sensor.toml").unlink()
    with pytest.raises(DatasetError, match=r"sensor\.toml: no such file"):
        read_dataset(tmp_path / "d")
