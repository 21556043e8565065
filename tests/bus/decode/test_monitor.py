"""`bus monitor`: every frame of real logs as tshark names it, values as packed by hand, transfers of a
foreign master and a foreign slave whole; no frame stops it."""

from __future__ import annotations

import gzip
import json
import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import durand
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.cli.main import bus
from palpate_bus.decode.decoder import Decoder, Service
from palpate_bus.decode.device import Device, devices_of_header
from palpate_bus.decode.emcy_text import emcy_text
from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.logs.candump import LogHeader, LogRecord, read_log, write_log
from palpate_bus.logs.pcap import write_pcap
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError

REPLAY = Path(__file__).parents[2] / "replay"


def said(can_id, data="", devices=None):
    return Decoder(devices).decode(LogRecord(0, CanFrame(can_id, bytes.fromhex(data))))


def log_of(name, folder):
    path = folder / f"{name}.log"
    path.write_bytes(gzip.decompress((REPLAY / f"{name}.log.gz").read_bytes()))
    return read_log(path)


TSHARK_NAMES = (
    ("NMT Error Control", Service.HEARTBEAT),
    ("NMT", Service.NMT),
    ("SYNC", Service.SYNC),
    ("TIME STAMP", Service.TIME),
    ("EMCY", Service.EMCY),
    ("Default-SDO", Service.SDO),
    ("LSS", Service.LSS),
)


def service_of(info):
    match = re.match(r"PDO\d \((t|r)x\)", info)
    if match:
        return Service.TPDO if match[1] == "t" else Service.RPDO
    return next((service for name, service in TSHARK_NAMES if info.startswith(name)), Service.OTHER)


@pytest.mark.parametrize("name", ["demo", "virtual"])
def test_services_are_those_that_tshark_sees(tmp_path, name):
    if shutil.which("tshark") is None:
        pytest.skip("tshark is missing: install it for a second opinion on every frame")
    log = log_of(name, tmp_path)
    write_pcap(tmp_path / "x.pcap", log.records)
    command = ["tshark", "-r", str(tmp_path / "x.pcap"), "-d", "can.subdissector,canopen", "-T", "fields"]
    done = subprocess.run([*command, "-e", "_ws.col.Info"], capture_output=True, text=True, check=True)
    decoder = Decoder(devices_of_header(log.header.entries))
    ours = [decoder.decode(record) for record in log.records]
    theirs = [service_of(line) for line in done.stdout.splitlines()]
    # The host's time stamp is every fingertip's RPDO 1 by the EDS; tshark goes by the identifier alone.
    differ = {d.frame.can_id for d, service in zip(ours, theirs, strict=True) if d.service is not service}
    # TPDO 5 has the identifier of an RPDO 2, which a fingertip does not have.
    assert differ <= {0x1FF, 0x310, 0x311, 0x312}
    assert not [decoded for decoded in ours if "malformed" in decoded.text or "unknown" in decoded.text]
    starts = [d.text for d in ours if d.service is Service.NMT and d.text.startswith("start")]
    assert len(starts) >= 12 and "start finger-1" in starts


def test_a_fingertips_values_have_names_and_units():
    """Packed by hand as docs/bus.md says."""
    tpdo_1 = said(0x190, struct.pack("<hhhh", -150, 42, 2970, 1234).hex())
    assert (tpdo_1.service, tpdo_1.node_id, tpdo_1.text) == (Service.TPDO, 0x10, "TPDO 1")
    assert [(r.name, r.value, r.unit) for r in tpdo_1.readings] == [
        ("Value of contact x", -1.5, "mm"),
        ("Value of contact y", pytest.approx(0.42), "mm"),
        ("Value of contact z", pytest.approx(29.7), "mm"),
        ("Value of normal force", pytest.approx(1.234), "N"),
    ]
    tpdo_2 = said(0x290, struct.pack("<hhhBB", 100, -100, 250, 5, 255).hex())
    assert [r.text for r in tpdo_2.readings] == [
        "0.100 N",
        "-0.100 N",
        "2.50 N mm",
        "5 (contact valid)",
        "255",
    ]
    not_given = said(0x290, struct.pack("<hhhBB", 100, -100, -0x8000, 5, 255).hex())
    assert not_given.readings[2].text == "-32768 (not given)"
    tpdo_5 = said(0x310, struct.pack("<Hhhh", 42, 35, 12, 34).hex())
    assert (tpdo_5.service, tpdo_5.node_id, tpdo_5.text) == (Service.TPDO, 0x10, "TPDO 5")
    assert [r.text for r in tpdo_5.readings] == ["42", "0.35 mm", "0.12 N mm", "0.034 N"]
    assert (
        said(0x310, struct.pack("<Hhhh", 42, -0x8000, -0x8000, -0x8000).hex()).readings[1].text
        == "-32768 (not given)"
    )
    no_force = said(0x290, struct.pack("<hhhBB", -0x8000, -0x8000, -0x8000, 0x19, 255).hex())
    assert [r.text for r in no_force.readings[2:4]] == [
        "-32768 (not given)",
        "25 (contact no place no force)",
    ]
    tpdo_4 = said(0x490, struct.pack("<hHHB", 0x7FFF, 3, 0, 128).hex())
    assert tpdo_4.readings[0].text == "32767 (unknown)"
    assert said(0x490, struct.pack("<hHHB", 412, 3, 0, 128).hex()).readings[0].text == "41.2 degC"


def test_the_hosts_time_stamp_is_one_frame_for_all_fingertips():
    """RPDO 1 of every fingertip, 1FFh, carries 1013h."""
    stamp = said(0x1FF, struct.pack("<I", 123_456_789).hex())
    assert (stamp.service, stamp.node_id, stamp.text) == (Service.RPDO, None, "RPDO 1")
    assert [(r.name, r.value, r.unit) for r in stamp.readings] == [
        ("High resolution time stamp", 123_456_789, "us")
    ]


def test_the_poses_of_a_fingertip_are_decoded_although_the_eds_disables_them():
    """Once the fingertip was heard; the identifiers are those of node 0x30."""
    decoder = Decoder()
    frames = [(0x710, b"\x05"), (0x1B0, struct.pack("<Hhhh", 7, 1234, -250, -0x8000))]
    records = [LogRecord(0, CanFrame(can_id, data)) for can_id, data in frames]
    _, pose = [decoder.decode(record) for record in records]
    assert (pose.service, pose.node_id, pose.text) == (Service.TPDO, 0x10, "TPDO 6")
    assert [(r.name, r.text) for r in pose.readings[1:]] == [
        ("Value of object depth", "1.234 mm"),
        ("Value of object tilt x", "-2.50 deg"),
        ("Value of object tilt y", "-32768 (not given)"),
    ]


def test_a_drives_values_have_names_and_units():
    rpdo = said(0x203, struct.pack("<Hbh", 0x0F, 10, -25).hex())
    assert (rpdo.service, rpdo.text) == (Service.RPDO, "RPDO 1")
    assert [r.text for r in rpdo.readings] == ["0xF (enable)", "10 (cyclic synchronous torque)", "-2.5 %"]
    assert [r.text for r in said(0x183, struct.pack("<ii", -90_000, 1500).hex()).readings] == [
        "-90.000 deg",
        "1.500 deg/s",
    ]
    status = said(0x283, struct.pack("<Hbh", 0x1637, 10, 0).hex())
    assert status.readings[0].text == "0x1637 (operation enabled)"


@pytest.mark.parametrize(
    ("can_id", "data", "text"),
    [
        (0x000, "01 00", "start all nodes"),
        (0x000, "82 10", "reset communication fingertip 0x10"),
        (0x000, "07 10", "unknown command 07h fingertip 0x10"),
        (0x000, "01", "malformed: 1 bytes"),
        (0x080, "", ""),
        (0x080, "11", "counter 17"),
        # CiA 301, 7.1.6.6: 12:34:56.789 is 45296789 ms = 2B32C95h; 15000 days after 1984-01-01
        (0x100, "95 2c b3 02 98 3a", "day 15000 since 1984-01-01, 12:34:56.789"),
        (0x100, "95 2b", "malformed: 2 bytes, a time stamp has 6"),
        (
            0x090,
            "30 81 11 00 00 00 00 00",
            "8130h heartbeat or life guarding lost; error register generic, communication",
        ),
        (
            0x090,
            "01 ff 81 07 00 00 00 00",
            "FF01h camera lost; error register generic, manufacturer, 07 00 00 00 00",
        ),
        (0x090, "00 00 00 00 00 00 00 00", "0000h error reset, or no error; error register none"),
        (0x0A1, "01 ff 81 00 00 00 00 00", "FF01h device specific; error register generic, manufacturer"),
        (0x090, "01 ff", "malformed: 2 bytes, an emergency has 8"),
        (0x710, "00", "boot-up"),
        (0x710, "7f", "pre-operational"),
        (0x710, "85", "operational"),
        (0x710, "", "malformed: 0 bytes"),
        (0x7E5, "51 00 00 00 00 80 00 00", "fastscan of all unconfigured nodes"),
        (0x7E5, "51 34 12 00 00 0b 03 00", "fastscan serial 0x00001234, bit 11 on, then vendor"),
        (0x7E4, "4f 00 00 00 00 00 00 00", "identified"),
        (0x7E5, "11 10 00 00 00 00 00 00", "configure node id or its result 16"),
        (0x190, "00 01", "TPDO 1: malformed: 2 bytes, its mapping has 8"),
        (0x1A5, "00 01", "TPDO 1 (no EDS): 00 01"),
        (0x521, "", "RPDO 4 (no EDS): "),
    ],
)
def test_texts(can_id, data, text):
    assert said(can_id, data).text == text


@pytest.mark.parametrize(
    ("code", "text"),
    [(0x8250, "RPDO timed out"), (0x4210, "device temperature"), (0xABCD, "unknown code")],
)
def test_emergency_codes(code, text):
    assert emcy_text(code) == text


def sdo(decoder, can_id, data):
    return decoder.decode(LogRecord(0, CanFrame(can_id, bytes.fromhex(data)))).text


def test_an_expedited_write_and_its_refusal():
    """Bytes of CiA 301, 7.2.4.3: 1017h = 500 ms; then a write to 1018h:01 that is read only."""
    decoder = Decoder()
    assert sdo(decoder, 0x610, "2b 17 10 00 f4 01 00 00") == "write 1017h:00 Producer heartbeat time = 500 ms"
    assert sdo(decoder, 0x590, "60 17 10 00 00 00 00 00") == "1017h:00 Producer heartbeat time: written"
    assert sdo(decoder, 0x610, "23 18 10 01 01 00 00 00").endswith("Identity object / Vendor-ID = 1")
    assert sdo(decoder, 0x590, "80 18 10 01 02 00 01 06") == (
        "1018h:01 Identity object / Vendor-ID: node aborts, 06010002h Attempt to write a read only object"
    )


@pytest.mark.long
def test_transfers_of_a_foreign_master_and_slave_come_out_whole(foreign):
    """Segmented and block, both ways: canopen against durand; the truth is what each was given."""
    name, domain = b"a device name that takes segments", bytes(range(256)) * 3
    with foreign.virtual_network("monitor", 1) as (master, (network,), recorder):
        node = durand.MinimalNode(network, 0x21)
        node.object_dictionary[0x1008] = durand.Variable(durand.DatatypeEnum.VISIBLE_STRING, "ro", name)
        node.object_dictionary[0x2345] = durand.Variable(durand.DatatypeEnum.DOMAIN, "rw", name="Big")
        remote = master.add_node(0x21)
        remote.sdo.RESPONSE_TIMEOUT = 30.0
        assert remote.sdo.upload(0x1008, 0) == name
        remote.sdo.download(0x2345, 0, domain[:300])
        with remote.sdo.open(0x2345, 0, "wb", size=len(domain), block_transfer=True) as big:
            big.write(domain)
        with remote.sdo.open(0x2345, 0, "rb", block_transfer=True) as big:
            assert big.read() == domain
    decoder = Decoder()
    texts = [
        decoded.text for decoded in map(decoder.decode, recorder.records) if decoded.service is Service.SDO
    ]
    whole = [text for text in texts if " = " in text]
    assert whole == [
        f"read 1008h:00 = {name.hex(' ')}",
        f"write 2345h:00 = {domain[:300].hex(' ')}",
        f"write 2345h:00 = {domain.hex(' ')}",
        f"read 2345h:00 = {domain.hex(' ')}",
    ]
    assert not [text for text in texts if "unknown" in text or "malformed" in text or "abort" in text]


FRAMES = st.builds(CanFrame, st.integers(0, 0x7FF), st.binary(max_size=8), st.booleans())
SDO_FRAMES = st.builds(CanFrame, st.sampled_from([0x590, 0x610]), st.binary(min_size=8, max_size=8))


@pytest.mark.long
@given(st.lists(st.one_of(FRAMES, SDO_FRAMES), max_size=80))
def test_no_frame_stops_it(frames):
    decoder = Decoder()
    for frame in frames:
        decoded = decoder.decode(LogRecord(0, frame))
        assert decoded.text.isprintable()


def run(*arguments):
    return CliRunner().invoke(bus, ["monitor", *map(str, arguments)], catch_exceptions=False)


def test_a_log_filtered_and_as_json(tmp_path):
    path = REPLAY / "virtual.log.gz"
    shown = run("--log", path, "--node", "0x11", "--service", "tpdo", "--count", 4, "--json").output
    lines = [json.loads(line) for line in shown.splitlines()]
    assert [(line["can_id"], line["device"], line["service"]) for line in lines] == [
        ("191", "finger-2", "tpdo"),
        ("291", "finger-2", "tpdo"),
        ("311", "finger-2", "tpdo"),
        ("391", "finger-2", "tpdo"),
    ]
    assert lines[0]["values"][2] == {"name": "Value of contact z", "value": 29.7, "unit": "mm", "raw": 2970}
    heartbeats = run(
        "--log", path, "--service", "heartbeat", "--node", 9, "--duration", 1
    ).output.splitlines()
    assert len(heartbeats) == 2 + 9  # boot-ups, then a heartbeat each 100 ms
    assert heartbeats[-1].endswith("curl_3          operational")


@pytest.mark.parametrize(
    ("entries", "name"),
    [({}, "drive 1"), ({"node.0x02": "drive:flexion"}, "node 0x01")],
    ids=["no hand", "hand"],
)
def test_a_foreign_master_beside_named_drives_is_no_drive(tmp_path, entries, name):
    """CANopenNode's canopend as a master is node 1."""
    write_log(tmp_path / "x.log", LogHeader(entries), [LogRecord(0, CanFrame(0x701, b"\x05"))])
    (line,) = run("--log", tmp_path / "x.log", "--json").output.splitlines()
    assert json.loads(line)["device"] == name


def test_an_eds_of_a_foreign_node(tmp_path):
    eds = tmp_path / "foreign.eds"
    eds.write_text(CIA402_EDS.read_text().replace("ProductName=palpate joint drive", "ProductName=other"))
    write_log(tmp_path / "x.log", LogHeader(), [LogRecord(0, CanFrame(0x1A5, struct.pack("<ii", -5, 7)))])
    shown = run("--log", tmp_path / "x.log", "--eds", f"0x25={eds}").output
    # 6064h's unit is the device's own affair in CiA 402, so only our drive has degrees.
    assert shown.split("node 0x25")[1].strip() == "TPDO 1: Position actual value -5, Velocity actual value 7"
    for wrong in ("0x25", "0x80=x.eds", "=x.eds"):
        with pytest.raises(ConfigError, match="NODE=FILE"):
            run("--log", tmp_path / "x.log", "--eds", wrong)


def test_what_is_no_eds_is_refused(tmp_path):
    (tmp_path / "x.eds").write_text("[FileInfo]\n")
    with pytest.raises(ConfigError, match="describes no object"):
        Device(1, "x", tmp_path / "x.eds")


def test_live_traffic_of_the_hub(hub, open_edge):
    node = open_edge("finger-1")
    shown = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "palpate_host.cli.main",
            "bus",
            "monitor",
            "--channel",
            str(hub.path),
            "--count",
            "2",
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    while shown.poll() is None:  # until the monitor listens and has seen two
        node.send([CanFrame(0x710, b"\x05")])
        try:
            shown.wait(0.05)
        except subprocess.TimeoutExpired:
            continue
    lines = shown.communicate()[0].splitlines()
    assert shown.returncode == 0
    assert [line.split(maxsplit=3)[1:] for line in lines] == [
        ["710", "heartbeat", "fingertip 0x10  operational"]
    ] * 2
