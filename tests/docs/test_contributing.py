"""The worked examples of CONTRIBUTING.md, followed to the letter: written, registered, run."""

from __future__ import annotations

import importlib.util
import re
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError
from palpate_host.common.mode import Mode
from palpate_host.config import hand_config
from palpate_host.drives.drive_group import DriveGroup
from palpate_host.service.host_core import HostCore

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def example(title: str) -> dict[str, str]:
    """Return file name -> text of the code blocks below a heading; a block's first line names its file."""
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    return dict(re.findall(r"^```\w+\n# ([\w./-]+)\n(.*?)^```$", section, re.MULTILINE | re.DOTALL))


def install(folder: Path, modules: dict[str, str], pyproject: str) -> None:
    """Do to `folder`, which is on sys.path, what pip does: modules, and entry points as metadata."""
    for name, text in modules.items():
        (folder / name).write_text(text)
    info = folder / "example-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: example\nVersion: 0.1\n")
    groups = tomllib.loads(pyproject)["project"]["entry-points"]
    lines = [
        line
        for group, entries in groups.items()
        for line in (f"[{group}]", *(f"{name} = {target}" for name, target in entries.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """A folder of installed packages; their modules are forgotten afterwards."""
    folder = tmp_path / "site-packages"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(folder))
    before = set(sys.modules)
    yield folder
    for name in set(sys.modules) - before:
        if (getattr(sys.modules[name], "__file__", None) or "").startswith(str(folder)):
            del sys.modules[name]


def virtual_bench():
    path = ROOT / "tests" / "host" / "virtual_bench.py"
    spec = importlib.util.spec_from_file_location("palpate_contributing_bench", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


JOINT = "flexion_2"
NODE = 5


def with_drive(bench, tmp_path, hand_toml: str) -> Path:
    """The hand of Table 4 with the joint of the example."""
    (line,) = re.findall(r"^  \{.*\},\n", hand_toml, re.MULTILINE)
    text, count = re.subn(rf'^  \{{name = "{JOINT}".*\n', line, bench.TABLE_4.read_text(), flags=re.MULTILINE)
    assert count == 1
    path = tmp_path / "hand.toml"
    path.write_text(text)
    return path


class RawBoard:
    """The motor board of the example, moved by a simulated joint."""

    def __init__(self, drive, plant) -> None:
        self.example, self.plant, self.motor = drive, plant, self
        self.slave = SimpleNamespace(node_id=NODE)  # the bench's name of a node on the bus
        self.torque_Nm, self.enabled = 0.0, 0
        self.commanded_us = self.now_us = 0

    def state(self, now_us):
        if self.now_us:
            self.plant.advance(now_us - self.now_us, self.torque_Nm)
        self.now_us = now_us

    def process(self, now_us, frames):
        self.state(now_us)
        answers = []
        for frame in frames:
            if frame.can_id == self.example.COMMAND_ID + NODE:
                self.enabled, torque_mNm = self.example.COMMAND.unpack(frame.data)
                self.torque_Nm, self.commanded_us = torque_mNm * 1e-3 * self.enabled, now_us
            elif frame.can_id == 0x80:
                plant = self.plant
                position, velocity = round(plant.position_rad * 1e6), round(plant.velocity_rad_s * 1e3)
                data = self.example.STATE.pack(self.enabled, position, velocity)
                answers.append(CanFrame(self.example.STATE_ID + NODE, data))
        if now_us - self.commanded_us > 200_000:
            self.enabled, self.torque_Nm = 0, 0.0
        return SimpleNamespace(frames_out=answers, next_due_us=now_us + 10_000)


@pytest.fixture
def raw_hand(packages, tmp_path):
    """The example's drive, installed, in one joint of a hand on a bench."""
    files = example("Add a drive")
    install(packages, {"raw_torque_drive.py": files["raw_torque_drive.py"]}, files["pyproject.toml"])
    bench = virtual_bench()
    config = hand_config.load(with_drive(bench, tmp_path, files["hand.toml"]))
    index = [joint.name for joint in config.joints].index(JOINT)
    assert config.joints[index].drive_node == NODE
    _, hand = bench.load_table_4()
    rig = bench.VirtualBench(all_cia402(config), hand)
    import raw_torque_drive

    rig.drives[index] = RawBoard(raw_torque_drive, rig.drives[index].plant)
    rig.core = HostCore(config, hand)
    return rig, index


def all_cia402(config):
    fingers = [
        msgspec.structs.replace(
            finger,
            joints=tuple(msgspec.structs.replace(joint, drive="cia402") for joint in finger.joints),
        )
        for finger in config.fingers
    ]
    return msgspec.structs.replace(config, fingers=tuple(fingers))


def test_a_drive_with_another_protocol_moves_its_joint(raw_hand):
    rig, index = raw_hand
    board, start_rad = rig.drives[index], rig.drives[index].plant.position_rad
    status = rig.run(1.5)
    assert status.mode is Mode.MANIPULATE, status.reason
    joint = status.joints[index]
    assert joint.drive_state == "on" and status.joints[0].drive_state == "operation enabled"
    assert joint.torque_Nm == joint.command_Nm != 0.0
    assert board.torque_Nm == pytest.approx(-joint.command_Nm, abs=1e-3)  # its direction is -1
    assert board.plant.position_rad == pytest.approx(-joint.position_rad, abs=1e-2)
    assert abs(board.plant.position_rad - start_rad) > 5e-3
    assert not [frame for _, frame in rig.log if frame.can_id == 0 and frame.data[1] == NODE]  # no NMT
    rig.core.request_stop()
    status = rig.run(2.0)
    assert status.mode is Mode.STOP and rig.output.finished
    assert (board.enabled, board.torque_Nm) == (0, 0.0)


def test_such_a_drive_that_falls_silent_stops_the_hand(raw_hand):
    rig, _ = raw_hand
    rig.run(1.5)
    rig.silent.add(NODE)
    status = rig.run(0.5)
    assert status.mode is Mode.FAULT
    assert status.reason == f"drive of {JOINT} (node 0x05): no position for more than 100 ms"


def test_an_unknown_drive_is_refused_with_the_allowed_keys(packages, tmp_path):
    files = example("Add a drive")
    path = with_drive(virtual_bench(), tmp_path, files["hand.toml"])
    with pytest.raises(ConfigError, match=rf"drive = 'raw' of {JOINT} is not one of cia402: [^\n]*$"):
        DriveGroup(hand_config.load(path))
    install(packages, {}, files["pyproject.toml"])  # registered, its module left out
    with pytest.raises(ConfigError, match=r"cannot be imported \(No module named 'raw_torque_drive'\)"):
        DriveGroup(hand_config.load(path))
    path.write_text(path.read_text().replace('"raw"', '"rwa"'))
    with pytest.raises(ConfigError, match="'rwa' of flexion_2 is not one of cia402, raw: "):
        DriveGroup(hand_config.load(path))
