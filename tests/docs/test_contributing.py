"""The worked examples of CONTRIBUTING.md, followed to the letter: written, registered, run."""

from __future__ import annotations

import configparser
import dataclasses
import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import threading
import tomllib
from pathlib import Path
from types import SimpleNamespace

import cv2
import msgspec
import numpy as np
import pytest

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.config import read_config
from palpate_host.common.mode import Mode
from palpate_host.config import hand_reader
from palpate_host.config.hand_config import RunConfig, StartMode
from palpate_host.drives.drive_group import DriveGroup
from palpate_host.operator.server import OperatorSocket
from palpate_host.service.host_core import HostCore

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def example(title: str) -> dict[str, str]:
    """Return file name -> text of the code blocks below a heading; a block's first line names its file."""
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    return dict(re.findall(r"^```\w+\n# ([\w./ -]+)\n(.*?)^```$", section, re.MULTILINE | re.DOTALL))


def apply_diff(path: Path, diff: str) -> None:
    """Insert the lines of `diff` that begin with + after the file's only line that begins as the one
    before."""
    lines = path.read_text(encoding="utf-8").splitlines()
    place = 0
    for edit in diff.splitlines():
        if edit.startswith("+"):
            place += 1
            lines.insert(place, edit[1:])
        else:
            (place,) = (number for number, line in enumerate(lines) if line.startswith(edit[1:]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def copy_of_sources(folder: Path, *more: str) -> dict[str, str]:
    """Copy the two programs and more paths; return an environment in which they are the installed ones."""
    heavy = shutil.ignore_patterns("palpate_twin", "__pycache__", "*.npz")
    for name in ("edge", "host", "firmware/fingertip.eds", "pyproject.toml", *more):
        source, copy = ROOT / name, folder / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, copy, symlinks=True, ignore=heavy)
        else:
            shutil.copy(source, copy)
    return environment(folder / "edge", folder / "host")


def environment(*folders: Path) -> dict[str, str]:
    """The environment of a subprocess that finds packages in these folders first."""
    return os.environ | {
        "PYTHONPATH": os.pathsep.join([*map(str, folders), os.environ.get("PYTHONPATH", "")])
    }


def run(command: list[str], folder: Path, environ: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: PLW1510 - the exit status is checked by the caller
        [sys.executable, *command], cwd=folder, env=environ, capture_output=True, text=True, timeout=120
    )


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
    path.write_text(text.replace('start = "command"', 'start = "auto"'))
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
    config = hand_reader.load(with_drive(bench, tmp_path, files["hand.toml"]))
    config = msgspec.structs.replace(config, run=RunConfig(start=StartMode.AUTO))
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
        DriveGroup(hand_reader.load(path))
    install(packages, {}, files["pyproject.toml"])  # registered, its module left out
    with pytest.raises(ConfigError, match=r"cannot be imported \(No module named 'raw_torque_drive'\)"):
        DriveGroup(hand_reader.load(path))
    path.write_text(path.read_text().replace('"raw"', '"rwa"'))
    with pytest.raises(ConfigError, match="'rwa' of flexion_2 is not one of cia402, raw: "):
        DriveGroup(hand_reader.load(path))


FINGERTIP = """
name = "finger-1"
{capture}
[estimator]
calibration = "drawn.cal"
[node]
id = 0x10
[bus]
interface = "palpate"
channel = "no-hub.sock"
"""


@pytest.fixture
def npy_fingertip(packages, tmp_path, drawn_dataset, drawn_calibration_file):
    """The example's source, installed, and a fingertip that captures by it."""
    files = example("Add a capture source")
    install(packages, {"npy_capture.py": files["npy_capture.py"]}, files["pyproject.toml"])
    shutil.copy(drawn_calibration_file, tmp_path / "drawn.cal")
    frames = tmp_path / tomllib.loads(files["finger-1.toml"])["capture"]["path"]
    frames.mkdir()
    for picture in sorted(drawn_dataset.rglob("*.png"))[:40]:
        np.save(frames / f"{picture.stem}.npy", cv2.imread(str(picture)))
    path = tmp_path / "finger-1.toml"
    path.write_text(FINGERTIP.format(capture=files["finger-1.toml"]))
    return path


def test_a_capture_source_gives_frames_to_the_fingertip(npy_fingertip, packages):
    environ = environment(packages)
    done = run(
        ["-m", "palpate_edge.cli.main", "check", "--config", str(npy_fingertip), "--json"], ROOT, environ
    )
    rows = {row["part"]: row for row in json.loads(done.stdout)}
    assert rows["camera"]["verdict"] == "ok", rows["camera"]
    assert rows["beads"]["verdict"] == "ok", rows["beads"]
    assert rows["bus"]["verdict"] == "fail"  # there is no hub
    for frame in (npy_fingertip.parent / "frames").iterdir():
        frame.unlink()
    done = run(
        ["-m", "palpate_edge.cli.main", "check", "--config", str(npy_fingertip), "--json"], ROOT, environ
    )
    rows = {row["part"]: row for row in json.loads(done.stdout)}
    assert rows["camera"]["verdict"] == "fail" and "no .npy file" in json.dumps(rows["camera"])


def test_an_unknown_capture_source_is_refused_with_the_allowed_names(npy_fingertip, packages):
    npy_fingertip.write_text(npy_fingertip.read_text().replace('"npy"', '"nyp"'))
    with pytest.raises(ConfigError, match=r'"nyp" is not one of v4l2, recorded, shared_memory, npy$'):
        read_config(npy_fingertip)


def patch_eds(path: Path, changes: str) -> None:
    """Set keys of existing sections, and insert new sections after the last one of their object, a new object
    after those with a lower index."""
    wanted = configparser.ConfigParser(interpolation=None)
    wanted.optionxform = str  # type: ignore[assignment,method-assign]
    wanted.read_string(changes)
    sections = re.split(r"^(?=\[)", path.read_text(), flags=re.MULTILINE)
    for name in wanted.sections():
        keys = dict(wanted[name])
        heads = [section.partition("]")[0][1:] for section in sections]
        if name in heads:
            index = heads.index(name)
            for key, value in keys.items():
                sections[index], count = re.subn(
                    rf"^{key}=.*$", f"{key}={value}", sections[index], flags=re.MULTILINE
                )
                assert count <= 1, (name, key)
                if not count:
                    sections[index] = f"{sections[index].rstrip()}\n{key}={value}\n\n"
        else:
            indices = [head[:4].lower() if re.match("[0-9A-Fa-f]{4}", head) else "" for head in heads]
            last = max(n for n, index in enumerate(indices) if "" < index <= name[:4].lower())
            text = "".join(f"{key}={value}\n" for key, value in keys.items())
            sections.insert(last + 1, f"[{name}]\n{text}\n")
    path.write_text("".join(sections))


@pytest.mark.slow
def test_a_contact_quantity_is_a_row_and_a_channel(tmp_path):
    files = example("Add a contact quantity")
    tests = [
        "tests/edge/node/test_contact_quantities.py",
        "tests/docs/test_contact_quantities.py",
        "docs/bus.md",
    ]
    environ = copy_of_sources(tmp_path, *tests)
    table = "edge/palpate_edge/common/contact_quantities.py"
    apply_diff(tmp_path / table, files[table])
    head, end, tail = (tmp_path / table).read_text().partition('\n)\n"""Rows in the order')
    (tmp_path / table).write_text(f"{head}\n{files['row of QUANTITIES'].rstrip()}{end}{tail}")
    commands = [shlex.split(line) for line in files["commands"].splitlines()]
    assert [command[0] for command in commands] == ["python", "python", "pytest"]
    check = commands[2][1:]
    before = run(["-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *check], tmp_path, environ)
    assert "Autozero indentation" in before.stdout  # the section that is missing, as the page promises
    patch_eds(tmp_path / "firmware/fingertip.eds", files["firmware/fingertip.eds"])
    for command in commands[:2]:
        done = run(command[1:], tmp_path, environ)
        assert done.returncode == 0, done.stderr
    after = run(["-m", "pytest", "-q", "-p", "no:cacheprovider", *check], tmp_path, environ)
    assert after.returncode == 0, after.stdout[-3000:]
    assert (
        "| indentation | 7130h:17 | 0.01 mm, 8000h not given | 11, place 2 |"
        in (tmp_path / "docs/bus.md").read_text()
    )


def with_commands(folder: Path) -> dict[str, str]:
    environ = copy_of_sources(folder)
    for name, text in example("Add a command").items():
        path = folder / name
        if path.exists():
            apply_diff(path, text)
        else:
            path.write_text(text)
    return environ


def test_a_command_of_the_host_is_a_file_and_a_line(tmp_path):
    environ = with_commands(tmp_path)
    shown = run(["-m", "palpate_host.cli.main", "--help"], tmp_path, environ)
    assert re.search(r"counters\s+Print the counters of the running host", shown.stdout), shown.stderr
    path = tmp_path / "s"
    command = ["-m", "palpate_host.cli.main", "counters", "--socket", str(path)]
    nobody = run(command, tmp_path, environ)
    assert nobody.returncode == 9 and nobody.stderr.startswith("error: no hand is running")
    bench = virtual_bench()
    rig = bench.VirtualBench(*bench.load_table_4())
    status = rig.run(0.1)
    server, stopped = OperatorSocket(path), threading.Event()

    def serve() -> None:
        while not stopped.wait(0.01):
            server.serve(lambda _command: None, status)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        done = run(command, tmp_path, environ)
    finally:
        stopped.set()
        thread.join()
        server.close()
    expected = [f"{name} {count}" for name, count in dataclasses.asdict(status.counters).items()]
    assert done.stdout.splitlines() == expected and status.counters.ticks > 0


def test_a_command_of_the_edge_is_a_file_and_two_lines(tmp_path, drawn_calibration, drawn_calibration_file):
    environ = with_commands(tmp_path)
    shown = run(["-m", "palpate_edge.cli.main", "--help"], tmp_path, environ)
    assert re.search(r"beads\s+Print the number of beads", shown.stdout), shown.stderr
    done = run(["-m", "palpate_edge.cli.main", "beads", str(drawn_calibration_file)], tmp_path, environ)
    counts = [int(line.split()[2]) for line in done.stdout.splitlines()]
    assert sum(counts) == len(drawn_calibration.beads)


def test_the_make_targets_of_the_page_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"\bmake ([a-z-]+)", PAGE))
    assert named and named <= targets
