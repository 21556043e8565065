"""finger.toml of a fingertip that has a recording as its camera, and no calibration."""

from __future__ import annotations

from pathlib import Path


def recorded_finger_toml(folder: Path, recording: Path, name: str = "alone", *, loop: bool = True) -> Path:
    """Write folder/finger.toml; the health file is folder/NAME.health."""
    path = folder / "finger.toml"
    path.write_text(
        f'name = "{name}"\nhealth = "{folder / name}.health"\n'
        f'[capture]\nsource = "recorded"\npath = "{recording}"\nloop = {str(loop).lower()}\n'
        '[node]\nid = 16\n[bus]\ninterface = "palpate"\n'
    )
    return path
