"""The choice of a camera on a command line, NAME=PATH, and its ring of frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from palpate_edge.capture.frame_ring import RingReader
from palpate_edge.common.errors import ConfigError


@dataclass(frozen=True, slots=True)
class CameraSource:
    """A camera to show. name: its title. path: a folder of ``palpate-edge record``, or a ring in shared
    memory."""

    name: str
    path: Path

    def open_ring(self) -> RingReader:
        """Open the ring at `path`. Raises ConfigError when the file is missing, CaptureError for no ring."""
        try:
            return RingReader(self.path)
        except FileNotFoundError as exc:
            raise ConfigError(
                f"{self.path}: no ring of frames: start the program that writes it first"
            ) from exc


def named_path(option: str, text: str, example: str) -> tuple[str, Path]:
    """Parse NAME=PATH, the value of an option. Raises ConfigError with an example for another form."""
    name, _, path = text.partition("=")
    if not name or not path:
        raise ConfigError(f"{option} {text}: write NAME=PATH, as in {example}")
    return name, Path(path)


def parse_camera(text: str) -> CameraSource:
    """Parse NAME=PATH. Raises ConfigError for another form, or when PATH does not exist."""
    name, path = named_path("--camera", text, "finger-1=frames/")
    if not path.exists():
        raise ConfigError(
            f"--camera {text}: {path}: no such file or folder:"
            " give a folder of palpate-edge record, or a ring"
        )
    return CameraSource(name, path)
