"""hand.toml: what is refused, and that the text names file, key and way out."""

import re

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.host.axes_hand import axes_text

from palpate_edge.common.errors import ConfigError
from palpate_host.config import hand_reader


@pytest.fixture
def table_4_text(bench):
    return bench.TABLE_4.read_text()


def test_table_4_is_the_papers(bench):
    config = hand_reader.load(bench.TABLE_4)
    assert (config.control.f_d_N, config.control.tip_radius_m) == (4.0, 0.030)
    assert [joint.drive_node for joint in config.joints] == list(range(1, 10))
    assert [finger.fingertip_node for finger in config.fingers] == [0x10, 0x11, 0x12]
    assert len(config.node_names) == 12


@pytest.mark.parametrize(
    ("pattern", "replacement", "says"),
    [
        (r"f_d_N = .*", "", r"key control.f_d_N \(a number above 0\) is missing; docs/configuration.md"),
        (r"f_d_N = .*", "f_d_N = 4\nfd = 3", r"unknown key control.fd; did you mean control.f_d_N\?$"),
        (r"f_d_N = .*", "f_d_N = -1", r"control.f_d_N = -1 is out of range: it must be a number above 0$"),
        (r"f_d_N = .*", 'f_d_N = "much"', r'control.f_d_N = "much" is not a number above 0$'),
        (r'mode = "proposed"', 'mode = "magic"', r'control.mode = "magic" is not one of proposed, blind$'),
        (
            r"tick_Hz = 100",
            "tick_Hz = 100000",
            r"control.tick_Hz = 100000 is out of range: .* whole number from 10 to 1000$",
        ),
        (
            r"drive_node = 9",
            "drive_node = 3",
            r"0x03 is used twice, by drive_node of curl_1 and by .* curl_3: change",
        ),
        (
            r"fingertip_node = 0x10",
            "fingertip_node = 1",
            r"0x01 is used twice, by fingertip_node of finger-1",
        ),
        (r"host_node = 0x7F", "host_node = 0x12", r"0x12 is used twice, by network.host_node"),
        (
            r"drive_node = 9",
            "drive_node = 128",
            r"drive_node = 128 is out of range: it must be a whole number from 1 to 127$",
        ),
        (r'name = "finger-2"', 'name = "finger-1"', r"'finger-1' is used twice"),
        (r'"tip_2"', '"tip_1"', r"model.tip_sites 'tip_1' is used twice"),
        (
            r'name = "finger-2"',
            'name = "finger 2"',
            r'fingers\[1\].name = "finger 2" is out of range: .* one word in quotes, without spaces$',
        ),
        (r"direction = 1", "direction = 0", r"direction of abduction_1 is 0: set 1 or -1"),
        (r"max_rad = 0.5", "max_rad = -0.5", r"min_rad of abduction_1 is not below its max_rad"),
        (r"freeze_ms = 250", "freeze_ms = 1200", r"tiers must grow.*correct \[staleness\]"),
        (r"heartbeat_timeout_ms = 500", "heartbeat_timeout_ms = 100", r"heartbeat_timeout_ms must exceed"),
        (r"\[target\]", "[target", r"line \d+, column \d+ is not valid TOML: "),
        (r"\[\[fingers\]\]\nname = .finger-3.[^]]*\]", "", r"fingers has 2 entries; it needs at least 3$"),
    ],
)
def test_refusals(tmp_path, table_4_text, pattern, replacement, says):
    path = tmp_path / "hand.toml"
    changed = re.sub(pattern, replacement, table_4_text, count=1)
    assert changed != table_4_text
    path.write_text(changed)
    with pytest.raises(ConfigError) as caught:
        hand_reader.load(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ") and "\n" not in text
    assert re.search(says, text), text


def test_joints_may_be_axes_of_one_node_each_finger(tmp_path, table_4_text):
    path = tmp_path / "hand.toml"
    path.write_text(axes_text(table_4_text))
    config = hand_reader.load(path)
    assert config.node_axes == {1: (0, 1, 2), 2: (0, 1, 2), 3: (0, 1, 2)}
    assert config.axis_names[2] == {0: "abduction_2", 1: "flexion_2", 2: "curl_2"}
    assert config.node_names[3] == "axes of abduction_3, flexion_3, curl_3"


@pytest.mark.parametrize(
    ("pattern", "replacement", "says"),
    [
        (
            r"drive_node = 1, axis = 1",
            "drive_node = 1, axis = 0",
            r"axis 0 of node 0x01 is used twice, by abduction_1",
        ),
        (
            r"drive_node = 2, axis = 1",
            "drive_node = 2",
            r"0x02 has several axes, and flexion_2 names none: set",
        ),
        (r"drive_node = 2, axis = 0", "drive_node = 2", r"0x02 is used twice, by drive_node of abduction_2"),
        (
            r"drive_node = 3, axis = 0",
            "drive_node = 0x10, axis = 0",
            r"0x10 is used twice, by fingertip_node",
        ),
        (r"axis = 0", "axis = 8", r"axis = 8 is out of range: it must be a whole number from 0 to 7"),
        (r"data_bitrate = \d+", "", r"axis of abduction_1 needs a CAN FD bus, .*: set bus.data_bitrate, or"),
        (r"axis = 0", 'axis = 0, drive = "raw"', r"axis of abduction_1 needs drive = 'cia402', not 'raw'"),
    ],
)
def test_refusals_of_axes(tmp_path, table_4_text, pattern, replacement, says):
    test_refusals(tmp_path, axes_text(table_4_text), pattern, replacement, says)


def test_axes_may_be_homed(tmp_path, table_4_text):
    path = tmp_path / "hand.toml"
    path.write_text(axes_text(table_4_text) + "\n[homing]\nmethod = 37\n")
    with pytest.raises(ConfigError, match=r"needs fingers\.joints\.home_rad of abduction_1"):
        hand_reader.load(path)
    path.write_text(path.read_text().replace("method = 37", "method = -1"))
    assert hand_reader.load(path).homing.method == -1


def test_a_file_that_everybody_may_write_is_refused(tmp_path, table_4_text):
    path = tmp_path / "hand.toml"
    path.write_text(table_4_text)
    path.chmod(0o646)
    with pytest.raises(ConfigError, match=r"hand\.toml may be written by everybody .mode 646.: chmod o-w"):
        hand_reader.load(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(
        ConfigError, match=r"hand\.toml: no such file; docs/configuration.md lists every key of a hand"
    ):
        hand_reader.load(tmp_path / "hand.toml")


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 10_000), damage=st.binary(max_size=6), cut=st.integers(0, 40))
def test_damaged_files_are_refused_in_one_line_or_read(tmp_path, bench, place, damage, cut):
    data = bench.TABLE_4.read_bytes()
    place %= len(data)
    path = tmp_path / "hand.toml"
    path.write_bytes(data[:place] + damage + data[place + cut :])
    try:
        hand_reader.load(path)
    except ConfigError as exc:
        assert "\n" not in str(exc)
