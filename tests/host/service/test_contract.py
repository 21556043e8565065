"""The contract of a log is what its frames mean: objects, values, model; not bytes and comments."""

from __future__ import annotations

import shutil
from pathlib import Path

import msgspec
import pytest
from tests.host.axes_hand import with_axes

from palpate_bus.decode.device import devices_of_header
from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.logs.candump import LogHeader
from palpate_edge.common.errors import ConfigError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.eds_history import EARLIER
from palpate_edge.node.parsed_eds import FINGERTIP_EDS, checksum_of
from palpate_host.service.contract import (
    BUILD,
    DIGEST,
    EDS_FILES,
    HAND,
    MODEL,
    check_contract,
    contract_header,
    eds_digest,
    meaning_of,
    recording_header,
)

LOG = Path("run.log")


@pytest.mark.parametrize(
    ("eds", "default"), [(FINGERTIP_EDS, "254"), (CIA402_EDS, "933")], ids=["fingertip", "cia402"]
)
def test_a_comment_in_an_eds_does_not_count_and_a_default_does(tmp_path, eds, default):
    text = eds.read_text()
    commented = tmp_path / "commented.eds"
    commented.write_text(f"; another comment\n{text}\n")
    assert eds_digest(commented) == eds_digest(eds)
    assert checksum_of(commented) != checksum_of(eds)
    other = tmp_path / "other.eds"
    other.write_text(text.replace(f"DefaultValue={default}", "DefaultValue=250", 1))
    assert other.read_text() != text
    assert eds_digest(other) != eds_digest(eds)


def test_an_earlier_eds_is_this_one_without_what_was_added(table_4):
    """Its logs are read. The digest was computed by the version of palpate that had no CAN FD."""
    od = load_eds(FINGERTIP_EDS, 1)
    earlier, commented = EARLIER
    assert commented.meaning == eds_digest(FINGERTIP_EDS)
    before = {key: entry for key, entry in od.entries.items() if key[0] not in (0x1809, 0x1A09, 0x2005)}
    assert meaning_of(msgspec.structs.replace(od, entries=before)) == earlier.meaning
    config, _ = table_4
    entries = {**contract_header(config).entries, "eds.fingertip.meaning": earlier.meaning}
    assert all("calibration" in lack for lack in check_contract(LOG, LogHeader(entries), config))


def entries_of_format_1(config) -> dict[str, str]:
    """The header as palpate wrote it before the digests of meaning: hashes of bytes, and nodes."""
    new = contract_header(config).entries
    old = {key: checksum_of(path) for key, path in EDS_FILES.items()}
    return old | {key: value for key, value in new.items() if key.startswith("node.")}


def test_an_old_log_says_what_it_lacks(table_4):
    config, _ = table_4
    entries = entries_of_format_1(config)
    (lack,) = check_contract(LOG, LogHeader(entries), config)
    assert lack.startswith("the values of hand.toml, the model's digest and the calibrations")
    entries["eds.fingertip"] = "0123456789abcdef"
    lacks = check_contract(LOG, LogHeader(entries), config)
    assert len(lacks) == 2
    assert "the meaning of fingertip.eds, whose bytes were others" in lacks[1]


def test_an_old_log_of_other_nodes_is_refused(table_4):
    config, _ = table_4
    entries = entries_of_format_1(config) | {"node.0x05": "drive:thumb"}
    with pytest.raises(ConfigError, match=r"node.0x05 'drive:thumb', here 'drive:flexion_2'"):
        check_contract(LOG, LogHeader(entries), config)


def test_a_log_without_nodes_names_the_command_that_gives_them(table_4):
    with pytest.raises(ConfigError, match=r"no node.0x.., so its nodes are unknown.*palpate-host contract"):
        check_contract(LOG, LogHeader(), table_4[0])


def test_the_build_is_recorded_and_not_compared(table_4):
    config, _ = table_4
    entries = dict(recording_header(config).entries)
    assert entries[BUILD].startswith("0.1.0+")
    entries[BUILD] = "0.0.9+aaaaaaaaaaaa"
    assert all("calibration" in lack for lack in check_contract(LOG, LogHeader(entries), config))


def test_another_model_file_is_refused(tmp_path, table_4):
    """Two MJCF files whose links differ by 1 mm; a comment and the file's name do not count."""
    from palpate_host.control.hand_model import spec_of

    config, _ = table_4
    path = tmp_path / "hand.xml"
    spec = spec_of(config)
    spec.compile()
    path.write_text(spec.to_xml())

    def with_model(name: Path):
        model = msgspec.structs.replace(config.model, mjcf=str(name))
        return msgspec.structs.replace(config, model=model, geometry=None)

    header = contract_header(with_model(path))
    same = tmp_path / "same.xml"
    same.write_text(f"{path.read_text()}\n<!-- a comment -->\n")
    check_contract(LOG, header, with_model(same))
    spec.bodies[2].pos[2] += 1e-3
    other = tmp_path / "other.xml"
    other.write_text(spec.to_xml())
    with pytest.raises(ConfigError, match=r"another model \(model.digest .* give the model.mjcf"):
        check_contract(LOG, header, with_model(other))
    shutil.rmtree(tmp_path)


def test_a_key_of_another_palpate_is_named_and_no_reason_to_refuse(table_4):
    config, _ = table_4
    entries = dict(contract_header(config).entries) | {f"{HAND}control.new_gain": "2.0", DIGEST: "0" * 16}
    del entries[f"{HAND}control.settle_ms"]
    lacks = check_contract(LOG, LogHeader(entries), config)
    assert "control.settle_ms, a key of this palpate" in lacks
    assert any("control.new_gain, which this palpate does not have" in lack for lack in lacks)


def test_every_line_is_short_enough_for_can_utils(table_4):
    """canplayer and log2asc stop at a line of 400 bytes; the shell takes each entry as one word."""
    header = contract_header(table_4[0])
    assert max(map(len, header.lines())) < 390
    assert not any(" " in value for value in header.entries.values())
    assert MODEL in header.entries


def test_a_hand_with_axes_names_them_and_their_eds(table_4):
    """Its nodes can be decoded from the header alone; a hand without axes has its former header."""
    config = with_axes(table_4[0], order=(2, 0, 1))
    entries = contract_header(config).entries
    assert entries["node.0x02"] == "axes:0=flexion_2,1=curl_2,2=abduction_2"
    assert entries["eds.cia402-axes.meaning"]
    device = devices_of_header(entries)[2]
    assert device.pdos[0x182].bits == 3 * 96 and device.pdos[0x202].bits == 3 * 32
    plain = contract_header(table_4[0]).entries
    assert "eds.cia402-axes.meaning" not in plain and not any("axis" in value for value in plain.values())


def test_a_log_of_other_axes_is_refused(tmp_path, table_4):
    path, config = tmp_path / "axes.log", with_axes(table_4[0])
    check_contract(path, contract_header(config), config)
    with pytest.raises(ConfigError, match=r"node.0x01 'axes:0=flexion_1,1=curl_1,2=abduction_1'"):
        check_contract(path, contract_header(with_axes(table_4[0], (2, 0, 1))), config)
    with pytest.raises(ConfigError, match=r"node.0x01"):
        check_contract(path, contract_header(table_4[0]), config)
