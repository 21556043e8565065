"""Which sensor a command simulates: from a dataset of the twin's, a description, or a seed."""

from __future__ import annotations

from pathlib import Path

from palpate_edge.common.errors import ConfigError
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_twin.camera.look import TWIN_FILE, TwinSensor, load_twin
from palpate_twin.camera.random_sensor import random_sensor, with_tolerances


def choose_sensor(path: Path | None, seed: int | None, layout: str | None = None) -> TwinSensor:
    """path: a folder with twin.json, such a file, or a sensor.toml (or its folder), whose tolerances and
    looks then come from `seed`; without a path everything does.

    Raises ConfigError or DatasetError for a file that cannot be used.
    """
    if path is None:
        return random_sensor(seed or 0, layout)
    if path.is_dir():
        path = path / (TWIN_FILE if (path / TWIN_FILE).exists() and seed is None else "sensor.toml")
    if path.suffix == ".json":
        return load_twin(path)
    sensor = read_sensor(path)
    if not sensor.markers.rings:
        raise ConfigError(f"{path}: without markers.rings the twin knows no beads: give them, or a twin.json")
    return with_tolerances(sensor, seed or 0)
