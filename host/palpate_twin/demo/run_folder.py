"""Run folder of the demo: paths and configuration files of one run."""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.common.atomic_write import make_folder, refused_as, write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.config import FingertipConfig, read_config
from palpate_host.config import hand_reader
from palpate_host.config.hand_config import HandConfig
from palpate_host.config.packaged import MODELS
from palpate_twin.demo.programme import TURNS_DEG

MODEL = MODELS / "table4-wide.toml"
SHARED_MEMORY = Path("/dev/shm")
LOCK = "run.lock"
RUN_KEYS = {"start": '"auto"'}  # nobody gives the demo's hand its first command
TWIN_KEYS = {
    "start_pose_rad": "[0.0, 0.06, 1.509]",  # 4 mm away from the object: the hand has to grasp it first
    "rpy_deg": str(list(TURNS_DEG[0])),
}
TWIN_CONTROL = 'law = "pose"\n'
"""Keys in which the demo's hand.toml differs from the packaged one, and keys added to its [control]."""
PUSH_S = 0.2
PUSHES_N = ((7.6, (0.0, 0.0, -2.0)), (15.6, (2.0, 0.0, 0.0)))
"""Simulated time in s, and force, of each push: after a turn's ramp, unless the hand is slow to begin."""
RECORDED_LOST_MS = 60_000  # recorded presses do not follow the hand: no object is lost when they end
DIGEST_DIGITS = 16  # of a calibration's checksum, as 2001h of its fingertip
MAX_SOCKET_PATH_BYTES = 107  # sun_path of unix(7) without the terminating zero

_BUS_SECTION = re.compile(r"^\[bus\]\n(?:(?!\[).*\n)*", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class RunFolder:
    """Paths of one run."""

    path: Path

    @property
    def calibration(self) -> Path:
        return self.path / "finger.cal"

    @property
    def hand_toml(self) -> Path:
        return self.path / "hand.toml"

    @property
    def hub_socket(self) -> Path:
        return self.path / "hub.sock"

    @property
    def clock(self) -> Path:
        """File with the simulated time."""
        return self.path / "clock"

    @property
    def control_socket(self) -> Path:
        """The host's control socket."""
        return self.path / "host.sock"

    @property
    def status_socket(self) -> Path:
        return self.path / "status.sock"

    @property
    def log(self) -> Path:
        return self.path / "bus.log"

    @property
    def summary(self) -> Path:
        return self.path / "summary.json"

    @property
    def truth(self) -> Path:
        """Folder with the true motion and the true contacts of the simulated hand."""
        return self.path / "truth"

    @property
    def motion(self) -> Path:
        return self.truth / "motion.csv"

    def pictures(self, finger: str) -> Path:
        """Return the folder with some of the pictures that a fingertip's camera took."""
        return self.truth / finger

    @property
    def has_pictures(self) -> bool:
        """True if pictures of fingertips were kept."""
        return any(self.truth.glob("*/*.jpg"))

    @property
    def sensors(self) -> Path:
        """Folder with the simulated fingertip sensors, kept between runs."""
        return self.path.parent / "sensors"

    @property
    def commands(self) -> Path:
        """Commands that were sent to the host's control socket, as JSON lines."""
        return self.path / "commands.jsonl"

    @property
    def film(self) -> Path:
        return self.path / "hand.webp"

    @property
    def picture(self) -> Path:
        return self.path / "view.svg"

    def ring(self, finger: str) -> Path:
        """Return the path of a fingertip's frame ring: in shared memory, named after this folder."""
        number = zlib.crc32(str(self.path).encode())
        return (SHARED_MEMORY if SHARED_MEMORY.is_dir() else self.path) / f"palpate-{number:08x}-{finger}"

    def finger_toml(self, name: str) -> Path:
        return self.path / f"{name}.toml"

    def hand(self) -> HandConfig:
        """Read hand.toml. Raises ConfigError."""
        return hand_reader.load(self.hand_toml)

    def fingertips(self) -> tuple[FingertipConfig, ...]:
        """Read the TOML file of each fingertip, in the hand's order. Raises ConfigError."""
        return tuple(read_config(self.finger_toml(finger.name)) for finger in self.hand().fingers)


@contextmanager
def locked_output(output: Path) -> Iterator[None]:
    """Keep other demos out of `output` until the block ends, or this process does.

    Raises ConfigError while another demo uses it, or when the folder cannot be made.
    """
    make_folder(output, ConfigError)
    path = output / LOCK
    with refused_as(path, ConfigError):
        lock = path.open("a+", encoding="ascii")
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.seek(0)
            holder = lock.read().strip() or "unknown"
            raise ConfigError(
                f"{output}: another demo runs there (pid {holder}): wait, or give another --output"
            ) from None
        with refused_as(path, ConfigError):
            lock.truncate(0)
            lock.write(f"{os.getpid()}\n")
            lock.flush()
        yield  # the lock file stays: to remove it would let two demos lock two files of this name


def make_run_folder(path: Path, recording: Path | None, bitrate: int) -> RunFolder:
    """Create an empty folder at `path` with hand.toml and one TOML file per fingertip.

    recording: a folder with press/ and one folder per finger of the hand; None to use the twin's cameras.
    Raises ConfigError if the recording is incomplete or `path` cannot be created.
    """
    folder = RunFolder(path.resolve())
    if len(str(folder.status_socket).encode()) > MAX_SOCKET_PATH_BYTES:
        raise ConfigError(
            f"{folder.path}: path too long for a Unix socket ({MAX_SOCKET_PATH_BYTES} bytes): "
            "give a shorter --output"
        )
    with refused_as(path, ConfigError):
        if path.exists():
            shutil.rmtree(path)
    make_folder(path, ConfigError)
    _write(folder.hand_toml, _hand_toml(folder, bitrate, is_twin=recording is None))
    hand = folder.hand()
    if recording is not None:
        _check_recording(recording, hand)
    bus = _bus_section(folder, bitrate, recording is None).rstrip()
    for finger in hand.fingers:
        if recording is None:
            capture = f'source = "shared_memory"\npath = {_quoted(folder.ring(finger.name))}\n'
            calibration = folder.sensors / f"{finger.name}.cal"
        else:
            capture = (
                f'source = "recorded"\npath = {_quoted(recording.resolve() / finger.name)}\nloop = true\n'
            )
            calibration = folder.calibration
        text = (
            f"name = {_quoted(finger.name)}\n\n[capture]\n{capture}\n"
            f"[estimator]\ncalibration = {_quoted(calibration)}\n\n"
            f"[node]\nid = 0x{finger.fingertip_node:02X}\n\n{bus}\n"
        )
        _write(folder.finger_toml(finger.name), text)
    return folder


def bind_calibrations(folder: RunFolder) -> None:
    """Write the digest of each fingertip's calibration into hand.toml, so that the run's log is bound to it.

    Raises CalibrationError when a calibration cannot be read.
    """
    text = folder.hand_toml.read_text(encoding="utf-8")
    for fingertip in folder.fingertips():
        digest = load_calibration(Path(fingertip.estimator.calibration)).checksum[:DIGEST_DIGITS]
        name = f"name = {_quoted(fingertip.name)}\n"
        text = text.replace(name, f'{name}calibration = "{digest}"\n', 1)
    _write(folder.hand_toml, text)


def _write(path: Path, text: str) -> None:
    write_atomically(path, text.encode(), ConfigError)


def _check_recording(recording: Path, hand: HandConfig) -> None:
    for part in ("press", *(finger.name for finger in hand.fingers)):
        if not (recording / part / "sensor.toml").is_file():
            raise ConfigError(
                f"{recording / part}/sensor.toml: no such file: --recording needs a folder with press/ and "
                "one folder per finger"
            )


def _bus_section(folder: RunFolder, bitrate: int, is_twin: bool) -> str:
    clock = f"clock = {_quoted(folder.clock)}\n" if is_twin else ""
    channel = _quoted(folder.hub_socket)
    return f'[bus]\ninterface = "palpate"\nchannel = {channel}\nbitrate = {bitrate}\n{clock}\n'


def _hand_toml(folder: RunFolder, bitrate: int, *, is_twin: bool) -> str:
    """Return the packaged hand.toml with this run's bus and, for the twin, the demo's keys."""
    section = _bus_section(folder, bitrate, is_twin)
    text, count = _BUS_SECTION.subn(lambda _match: section, MODEL.read_text(encoding="utf-8"))
    if count != 1:
        raise ConfigError(f"{MODEL}: {count} [bus] sections instead of one: reinstall palpate")
    for key, value in (RUN_KEYS | (TWIN_KEYS if is_twin else {})).items():
        text = re.sub(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
    if is_twin:
        pushes = "".join(
            f"\n[[twin.disturbances]]\nstart_s = {start_s}\nduration_s = {PUSH_S}\n"
            f"force_N = {list(force_N)}\n"
            for start_s, force_N in PUSHES_N
        )
        return text.replace("\n[control]\n", f"\n[control]\n{TWIN_CONTROL}") + pushes
    return text.replace("\nwarn_ms =", f"\nlost_ms = {RECORDED_LOST_MS}\nwarn_ms =")


def _quoted(value: Path | str) -> str:
    """Return a TOML basic string; its escapes are those of JSON."""
    return json.dumps(str(value), ensure_ascii=False)
