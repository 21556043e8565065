"""A log through the host: bit for bit the committed answers, whenever and wherever it runs.

``demo.log.gz`` is what the demo's processes said on the bus, ``virtual.log.gz`` a run in virtual time;
refresh.py makes both.
"""

import gzip
import os
import subprocess
import sys
from pathlib import Path

import pytest

import palpate_host
from palpate_bus.logs.candump import LogError, LogHeader, LogRecord, read_log, write_log
from palpate_edge.common.errors import ConfigError
from palpate_host.common.mode import Mode
from palpate_host.service.contract import check_contract, contract_header
from palpate_host.service.host import load_hand
from palpate_host.service.replay import replay, replay_to_log

HERE = Path(__file__).parent
TABLE_4 = Path(palpate_host.__file__).parent / "models" / "table4.toml"
REPLAY = "from palpate_host.cli.replay import replay; replay()"


@pytest.fixture(scope="session")
def hand_and_config():
    return load_hand(TABLE_4)


@pytest.fixture(params=["demo", "virtual"])
def name(request):
    return request.param


@pytest.fixture
def log(tmp_path, name):
    path = tmp_path / f"{name}.log"
    path.write_bytes(gzip.decompress((HERE / f"{name}.log.gz").read_bytes()))
    return path


def test_answers_are_the_golden_ones_in_every_time_zone(tmp_path, log, name):
    golden = gzip.decompress((HERE / f"{name}.answers.log.gz").read_bytes())
    for number, zone in enumerate(("UTC", "Asia/Kathmandu"), 1):
        answers = tmp_path / f"answers-{number}.log"
        done = subprocess.run(
            [sys.executable, "-c", REPLAY, str(log), "--config", str(TABLE_4), "-o", str(answers)],
            env={**os.environ, "TZ": zone, "PYTHONHASHSEED": str(number)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert "modes: init check ready grasp manipulate" in done.stdout
        assert answers.read_bytes() == golden, (
            "the host answers otherwise than before; if meant: python tests/replay/refresh.py"
        )


def test_the_golden_log_shows_what_it_should(log, name, hand_and_config):
    """The fingertips of ``demo`` played recorded presses, so that two of them leave the object at the end."""
    result = replay_to_log(log, *hand_and_config)
    assert result.modes[:5] == (Mode.INIT, Mode.CHECK, Mode.READY, Mode.GRASP, Mode.MANIPULATE)
    assert Mode.BLIND in result.modes
    ends = {"demo": "the object is lost: no contact of finger-2, finger-3 for 250 ms", "virtual": ""}
    assert result.failure == ends[name]


@pytest.mark.parametrize("name", ["virtual"], indirect=True)
def test_the_answers_are_what_the_live_host_sent(log, hand_and_config):
    """The recorded host ran in virtual time too, so the replay must give its very frames and times."""
    records = read_log(log).records
    nodes = hand_and_config[0].node_names
    host_ids = {0x000, 0x080, 0x1FF, 0x77F} | {base + node for node in nodes for base in (0x200, 0x600)}
    sent = [(record.stamp_us, record.frame) for record in records if record.frame.can_id in host_ids]
    answered = [(record.stamp_us, record.frame) for record in replay_to_log(log, *hand_and_config).records]
    assert answered == sent


def test_one_changed_byte_changes_the_answers(log, hand_and_config):
    """The comparison would see it: a contact moved by 0.64 mm is another torque somewhere."""
    records = list(read_log(log).records)
    mark = [i for i, record in enumerate(records) if record.frame.can_id == 0x190][20]
    data = bytearray(records[mark].frame.data)
    data[2] ^= 0x40
    changed = LogRecord(records[mark].stamp_us, type(records[mark].frame)(0x190, bytes(data)))
    result = replay([*records[:mark], changed, *records[mark + 1 :]], *hand_and_config)
    assert result.records != replay(records, *hand_and_config).records


@pytest.mark.parametrize(
    ("key", "value", "way_out"),
    [
        ("eds.fingertip.meaning", "0123456789abcdef", "the palpate version that made it"),
        ("eds.cia402.meaning", "0123456789abcdef", "the palpate version that made it"),
        ("model.digest", "0123456789abcdef", "give the model.mjcf that it was recorded with"),
        ("node.0x10", "drive:thumb", "the hand.toml that it was recorded with"),
        ("node.0x10", None, "the hand.toml that it was recorded with"),
    ],
)
def test_a_log_of_another_contract_is_refused(tmp_path, hand_and_config, key, value, way_out):
    config, _ = hand_and_config
    entries = dict(contract_header(config).entries)
    if value is None:
        del entries[key]
    else:
        entries[key] = value
    with pytest.raises(ConfigError, match=key) as caught:
        check_contract(tmp_path / "x.log", LogHeader(entries), config)
    assert way_out in str(caught.value) and "\n" not in str(caught.value)


def test_an_empty_log_is_refused(tmp_path, hand_and_config):
    path = tmp_path / "empty.log"
    write_log(path, contract_header(hand_and_config[0]), [])
    with pytest.raises(LogError, match="contains no CANopen frame"):
        replay_to_log(path, *hand_and_config)
