"""The run folder: everything one run of the demo reads and writes, as the commands want it."""

from __future__ import annotations

import json
import re
import shutil
import zlib
from dataclasses import dataclass
from pathlib import Path

from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.config import FingertipConfig, read_config
from palpate_host.config import hand_config
from palpate_host.config.hand_config import HandConfig
from palpate_host.config.packaged import MODELS
from palpate_twin.demo.programme import TURNS_DEG

MODEL = MODELS / "table4-wide.toml"
SHARED_MEMORY = Path("/dev/shm")
TWIN_KEYS = {
    "start_pose_rad": "[0.0, 0.06, 1.509]",  # open by 4 mm: the hand closes on the object first
    "rpy_deg": str(list(TURNS_DEG[0])),
}
TWIN_CONTROL = "integral_per_s = 1.0\nposition_stiffness_N_m = 300.0\n"
"""Where the demo's hand differs from the packaged one, and what it has in [control] besides."""
MAX_SOCKET_PATH_BYTES = 107  # sun_path of unix(7), less the closing zero

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
        """The time of the twin's hand."""
        return self.path / "clock"

    @property
    def control_socket(self) -> Path:
        """Where the host takes commands."""
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
        """What the twin's hand and fingertips really did."""
        return self.path / "truth"

    @property
    def motion(self) -> Path:
        return self.truth / "motion.csv"

    @property
    def sensors(self) -> Path:
        """The twin's fingertips, kept from run to run."""
        return self.path.parent / "sensors"

    @property
    def commands(self) -> Path:
        """What was asked of the host over its control socket."""
        return self.path / "commands.jsonl"

    @property
    def film(self) -> Path:
        return self.path / "hand.webp"

    @property
    def picture(self) -> Path:
        return self.path / "view.svg"

    def ring(self, finger: str) -> Path:
        """Where the twin writes a fingertip's frames: in memory, by a name of this folder's own."""
        number = zlib.crc32(str(self.path).encode())
        return (SHARED_MEMORY if SHARED_MEMORY.is_dir() else self.path) / f"palpate-{number:08x}-{finger}"

    def finger_toml(self, name: str) -> Path:
        return self.path / f"{name}.toml"

    def hand(self) -> HandConfig:
        """hand.toml as read back. Raises ConfigError."""
        return hand_config.load(self.hand_toml)

    def fingertips(self) -> tuple[FingertipConfig, ...]:
        """Each fingertip's TOML as read back, in the hand's order. Raises ConfigError."""
        return tuple(read_config(self.finger_toml(finger.name)) for finger in self.hand().fingers)


def make_run_folder(path: Path, recording: Path | None, bitrate: int) -> RunFolder:
    """An empty folder at `path` with hand.toml, its model and one TOML a fingertip.

    recording: holds press/ and one folder for each finger of the hand; None: the fingertips see the twin.
    Raises ConfigError when it does not, or when `path` cannot be made.
    """
    folder = RunFolder(path.resolve())
    if len(str(folder.status_socket).encode()) > MAX_SOCKET_PATH_BYTES:
        raise ConfigError(f"{folder.path}: too long a path for a Unix socket: give a shorter --output")
    try:
        if path.exists():
            shutil.rmtree(path)
        path.mkdir(parents=True)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be made anew ({error.strerror}): give another --output") from error
    folder.hand_toml.write_text(_hand_toml(folder, bitrate, is_twin=recording is None), encoding="utf-8")
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
        folder.finger_toml(finger.name).write_text(text, encoding="utf-8")
    return folder


def _check_recording(recording: Path, hand: HandConfig) -> None:
    for part in ("press", *(finger.name for finger in hand.fingers)):
        if not (recording / part / "sensor.toml").is_file():
            raise ConfigError(
                f"{recording / part}: no recording there (no sensor.toml): give the folder with press/ and "
                "one folder a finger as --recording"
            )


def _bus_section(folder: RunFolder, bitrate: int, is_twin: bool) -> str:
    clock = f"clock = {_quoted(folder.clock)}\n" if is_twin else ""
    channel = _quoted(folder.hub_socket)
    return f'[bus]\ninterface = "palpate"\nchannel = {channel}\nbitrate = {bitrate}\n{clock}\n'


def _hand_toml(folder: RunFolder, bitrate: int, *, is_twin: bool) -> str:
    """The packaged hand on this run's bus; with the twin, turning its object."""
    section = _bus_section(folder, bitrate, is_twin)
    text, count = _BUS_SECTION.subn(lambda _match: section, MODEL.read_text(encoding="utf-8"))
    if count != 1:
        raise ConfigError(f"{MODEL}: has {count} [bus] sections: restore it, it must have one")
    if is_twin:
        for key, value in TWIN_KEYS.items():
            text = re.sub(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        text = text.replace("[control]\n", f"[control]\n{TWIN_CONTROL}")
    return text


def _quoted(value: Path | str) -> str:
    """A TOML basic string: its escapes are those of JSON."""
    return json.dumps(str(value), ensure_ascii=False)
