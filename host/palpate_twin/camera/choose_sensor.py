"""Select the sensor that a command simulates: from a dataset, a description, or a seed."""

from __future__ import annotations

from pathlib import Path

from palpate_edge.common.errors import ConfigError
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_twin.camera.look import TWIN_FILE, TwinSensor, load_twin
from palpate_twin.camera.random_sensor import random_sensor, with_tolerances


def choose_sensor(path: Path | None, seed: int | None, layout: str | None = None) -> TwinSensor:
    """Return the sensor of a file, or a random one.

    path: a folder with twin.json, a twin.json, or a sensor.toml (or its folder), whose tolerances and
    appearance are drawn from `seed`; None draws everything from `seed`. Raises ConfigError or DatasetError
    for an unusable file.
    """
    if path is None:
        return random_sensor(seed or 0, layout)
    if path.is_dir():
        path = path / (TWIN_FILE if (path / TWIN_FILE).exists() and seed is None else "sensor.toml")
    if path.suffix == ".json":
        return load_twin(path)
    sensor = read_sensor(path)
    if not sensor.markers.rings:
        raise ConfigError(
            f"{path}: has no markers.rings, which the twin needs: add them, or give a twin.json"
        )
    return with_tolerances(sensor, seed or 0)
