"""Bad configurations and surroundings of ``palpate-edge run``."""

from __future__ import annotations

import shutil

import pytest

PATIENCE_S = 60


def says(text, *parts):
    for part in parts:
        assert str(part) in text


@pytest.fixture
def run_refused(refused, fingertip):
    """Refusal of ``palpate-edge run`` with (old, new) pairs of text changed in a good configuration."""
    return lambda *changes: refused("run", "--config", fingertip(*changes))


def test_a_configuration_that_is_not_there(refused, tmp_path):
    says(
        refused("run", "--config", tmp_path / "none.toml"),
        tmp_path / "none.toml",
        "no such file",
        "docs/configuration.md lists every key",
    )


@pytest.mark.long
def test_a_configuration_that_everybody_may_write(refused, fingertip):
    path = fingertip()
    path.chmod(0o666)
    says(refused("run", "--config", path), path, "may be written by everybody (mode 666)", "chmod o-w")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "key name (text in quotes) is missing; docs/configuration.md"),
        (b"[capture", "not valid TOML: "),
        (b"\xff\xfe\x00garbled", "line 1 is not UTF-8 text"),
        (b"a = " + b"[" * 5000, "not valid TOML: brackets are nested too deeply"),
        (b"a = " + b"9" * 5000, "not valid TOML: a number has too many digits"),
    ],
    ids=["empty", "cut short", "no text", "deep", "long number"],
)
def test_a_garbled_configuration(refused, tmp_path, content, message):
    path = tmp_path / "finger.toml"
    path.write_bytes(content)
    says(refused("run", "--config", path), path, message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("loop = true", "loop = true\nlop = true"), "unknown key capture.lop; did you mean capture.loop?"),
        (("[node]", "[nodes]"), "unknown section [nodes]; did you mean [node]?"),
        (("id = 16", "id = 0"), "node.id = 0 is out of range: it must be a whole number from 1 to 127"),
        (("id = 16", "id = 128"), "node.id = 128 is out of range"),
        (("id = 16", 'id = "16"'), 'node.id = "16" is not a whole number'),
        (("id = 16", ""), "key node.id (a whole number) is missing"),
        (('"recorded"', '"webcam"'), 'source = "webcam" is not one of v4l2, recorded, shared_memory'),
        (("loop = true", "loop = 1"), "capture.loop = 1 is not true or false"),
        (("[bus]", "[bus]\nbitrate = 5"), "bus.bitrate = 5 is out of range: it must be a whole number from"),
        (
            ("[estimator]", '[estimator]\nmethod = "guess"'),
            'method = "guess" is not one of best, paper, corrected',
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "->".join(value).replace("\n", " "),
)
def test_a_key_that_is_unknown_or_out_of_range_is_named(run_refused, change, message):
    says(run_refused(change), "finger.toml", message)


def test_a_bus_interface_that_does_not_exist(run_refused):
    says(run_refused(('"palpate"', '"canned"')), "finger", "canned", "socketcan or palpate")


def test_no_hub(run_refused, tmp_path):
    said = run_refused()
    says(said, tmp_path / "hub.sock", "palpate-host bus hub", "bus.interface")


def test_frames_that_are_not_there(run_refused, drawn_dataset, tmp_path):
    says(run_refused((str(drawn_dataset), "nowhere")), tmp_path / "nowhere", "no such folder")


def test_an_empty_folder_of_frames(run_refused, drawn_dataset, tmp_path):
    (tmp_path / "empty").mkdir()
    says(run_refused((str(drawn_dataset), "empty")), tmp_path / "empty", "has no image")


def test_a_video_that_is_no_video(run_refused, drawn_dataset, tmp_path):
    (tmp_path / "frames.mp4").write_bytes(b"no video" * 100)
    says(run_refused((str(drawn_dataset), "frames.mp4")), tmp_path / "frames.mp4", "is not a video")


def test_a_calibration_that_is_not_there(run_refused, drawn_calibration_file, tmp_path):
    said = run_refused((str(drawn_calibration_file), "none.cal"))
    says(said, tmp_path / "none.cal", "make it with palpate-edge calibrate")


def test_a_calibration_that_was_changed(run_refused, drawn_calibration_file, tmp_path):
    text = drawn_calibration_file.read_text()
    (tmp_path / "changed.cal").write_text(text.replace('"ring": 5', '"ring": 4', 1))
    said = run_refused((str(drawn_calibration_file), "changed.cal"))
    says(said, tmp_path / "changed.cal", "was changed or damaged", "palpate-edge calibrate")


def test_a_calibration_of_another_sensor_than_the_configured_one(run_refused, drawn_dataset, tmp_path):
    other = (drawn_dataset / "sensor.toml").read_text().replace("wall_mm = 5.0", "wall_mm = 4.0")
    (tmp_path / "other.toml").write_text(other)
    said = run_refused(("[estimator]", '[estimator]\nsensor = "other.toml"'))
    says(said, tmp_path / "other.toml", "was made for sensor", "palpate-edge calibrate")


def test_frames_of_another_sensor_by_its_description(run_refused, drawn_dataset, tmp_path):
    shutil.copytree(drawn_dataset, tmp_path / "other")
    text = (drawn_dataset / "sensor.toml").read_text()
    (tmp_path / "other" / "sensor.toml").write_text(text.replace("wall_mm = 5.0", "wall_mm = 4.0"))
    said = run_refused((str(drawn_dataset), "other"))
    says(said, tmp_path / "other" / "sensor.toml", "was made for sensor", "palpate-edge calibrate")


def test_frames_of_another_sensor_of_the_same_make(run_refused, another_dome, drawn_dataset, tmp_path):
    twin = another_dome(offset_mm=(-0.5, 0.4, -0.2), tilt_rad=(-0.012, 0.01), focal_scale=0.99)
    twin.write(tmp_path / "twin", presses=2)
    said = run_refused((str(drawn_dataset), "twin"))
    says(said, "of another sensor", "px off", "run palpate-edge calibrate")


# With a hub, as processes


def last_words(process):
    """Everything a process says until it ends: standard error's lines."""
    out, err = process.communicate(timeout=PATIENCE_S)
    assert out == ""
    assert "Traceback" not in err
    return err.splitlines()


def wait_until_it_runs(process):
    """The daemon says on standard error when it is on the bus."""
    line = process.stderr.readline()
    assert "node 0x" in line, line + process.stderr.read()


def test_a_hub_that_dies_is_told_and_found_again(edge, hub, start_hub, fingertip, tmp_path):
    process = edge("run", "--config", fingertip())
    wait_until_it_runs(process)
    hub.kill()
    says(
        process.stderr.readline(), "the bus is down", tmp_path / "hub.sock", "finger", "palpate-host bus hub"
    )
    start_hub()
    says(process.stderr.readline(), "the bus is up")
    process.terminate()
    said = last_words(process)
    assert process.returncode == 0
    assert not any(line.startswith("error: ") for line in said)


def test_a_node_id_that_is_used_twice(edge, hub, fingertip):
    """Both continue, without contacts, and one of them or both report it."""
    processes = [edge("run", "--config", fingertip(name=name)) for name in ("thumb", "index")]
    for process in processes:
        wait_until_it_runs(process)
    while "is used twice" not in (line := processes[0].stderr.readline()):
        assert line
    says(line, "node id 0x10 is used twice", "give one of them another [node] id")
    for process in processes:
        assert process.poll() is None
        process.terminate()
        last_words(process)
        assert process.returncode == 0


def test_a_frame_that_goes_bad_while_the_daemon_runs(edge, hub, fingertip, drawn_dataset, tmp_path):
    shutil.copytree(drawn_dataset, tmp_path / "d", ignore=shutil.ignore_patterns("truth.csv"))
    bad = tmp_path / "d" / "frames" / "020.png"
    bad.write_bytes(bad.read_bytes()[:500])
    process = edge("run", "--config", fingertip((str(drawn_dataset), "d")))
    said = last_words(process)
    assert process.returncode == 5
    assert [line for line in said if line.startswith("error: ")] == said[-1:]
    says(said[-1], "the recording stopped", bad, "is cut short", "record or copy it again")


def test_a_stop_signal_is_no_error(edge, hub, fingertip):
    process = edge("run", "--config", fingertip())
    wait_until_it_runs(process)
    process.terminate()
    said = last_words(process)
    assert process.returncode == 0
    assert not any(line.startswith("error: ") for line in said)


def test_the_real_command_line_says_one_line_and_leaves_nothing(
    edge, monkeypatch, drawn_dataset, drawn_calibration_file, tmp_path
):
    """The same as in test_files.py, through processes of their own."""
    monkeypatch.delenv("OPENCV_FFMPEG_LOGLEVEL")
    image, video = tmp_path / "frame.png", tmp_path / "frames.mp4"
    image.write_bytes((drawn_dataset / "frames" / "050.png").read_bytes()[:500])
    video.write_bytes(b"no video" * 100)
    processes = [
        edge("estimate", path, "--calibration", drawn_calibration_file, "--csv", tmp_path / "out.csv")
        for path in (image, video)
    ]
    for process, path, reason in zip(
        processes, (image, video), ("is cut short", "is not a video"), strict=True
    ):
        said = last_words(process)
        assert process.returncode == 3
        assert len(said) == 1
        says(said[0], "error: ", path, reason, "record or copy it again")
    assert set(tmp_path.iterdir()) == {image, video}


def test_an_unknown_option_is_not_a_traceback(edge):
    process = edge("run", "--konfig", "x")
    _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2
    assert "No such option" in err
    assert "Traceback" not in err
