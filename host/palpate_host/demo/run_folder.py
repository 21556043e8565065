"""The run folder: everything one run of the demo reads and writes, as the commands want it."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from palpate_edge.config import FingertipConfig, read_config
from palpate_edge.errors import ConfigError
from palpate_host import hand_config
from palpate_host.hand_config import HandConfig

MODEL = Path(__file__).parents[1] / "models" / "table4.toml"
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
    def picture(self) -> Path:
        return self.path / "view.svg"

    def finger_toml(self, name: str) -> Path:
        return self.path / f"{name}.toml"

    def hand(self) -> HandConfig:
        """hand.toml as read back. Raises ConfigError."""
        return hand_config.load(self.hand_toml)

    def fingertips(self) -> tuple[FingertipConfig, ...]:
        """Each fingertip's TOML as read back, in the hand's order. Raises ConfigError."""
        return tuple(read_config(self.finger_toml(finger.name)) for finger in self.hand().fingers)


def make_run_folder(path: Path, recording: Path, bitrate: int) -> RunFolder:
    """An empty folder at `path` with hand.toml, its model and one TOML a fingertip.

    recording: holds press/ and one folder for each finger of the hand. Raises ConfigError when it does not,
    or when `path` cannot be made.
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
    folder.hand_toml.write_text(_hand_toml(folder, bitrate), encoding="utf-8")
    hand = folder.hand()
    for part in ("press", *(finger.name for finger in hand.fingers)):
        if not (recording / part / "sensor.toml").is_file():
            raise ConfigError(
                f"{recording / part}: no recording there (no sensor.toml): give the folder with press/ and "
                "one folder a finger as --recording"
            )
    for finger in hand.fingers:
        text = _fingertip_toml(folder, recording.resolve() / finger.name, finger.fingertip_node, bitrate)
        folder.finger_toml(finger.name).write_text(text, encoding="utf-8")
    return folder


def _bus_section(folder: RunFolder, bitrate: int) -> str:
    return f'[bus]\ninterface = "palpate"\nchannel = {_quoted(folder.hub_socket)}\nbitrate = {bitrate}\n\n'


def _hand_toml(folder: RunFolder, bitrate: int) -> str:
    """The packaged hand on this run's bus."""
    section = _bus_section(folder, bitrate)
    text, count = _BUS_SECTION.subn(lambda _match: section, MODEL.read_text(encoding="utf-8"))
    if count != 1:
        raise ConfigError(f"{MODEL}: has {count} [bus] sections: restore it, it must have one")
    return text


def _fingertip_toml(folder: RunFolder, recording: Path, node_id: int, bitrate: int) -> str:
    return (
        (
            f"name = {_quoted(recording.name)}\n\n"
            f'[capture]\nsource = "recorded"\npath = {_quoted(recording)}\nloop = true\n\n'
            f"[estimator]\ncalibration = {_quoted(folder.calibration)}\n\n"
            f"[node]\nid = 0x{node_id:02X}\n\n"
        )
        + _bus_section(folder, bitrate).rstrip()
        + "\n"
    )


def _quoted(value: Path | str) -> str:
    """A TOML basic string: its escapes are those of JSON."""
    return json.dumps(str(value), ensure_ascii=False)
