"""Write a pose dataset whose pictures are links: public sets without a licence are linked and not copied."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class LinkedPress:
    """A row of truth.csv: the frame's name, its picture, the split, and the labels as the set has them."""

    name: str
    picture: Path
    split: str
    values: Sequence[str]


def write_linked(
    output: Path,
    references: Iterable[Path],
    labels: Iterable[str],
    presses: Iterable[LinkedPress],
    sensor: str,
) -> None:
    """Write sensor.toml with the text `sensor`, truth.csv, and the links."""
    for name in ("reference", "frames"):
        (output / name).mkdir(parents=True)
    for picture in references:
        (output / "reference" / picture.name).symlink_to(picture.resolve())
    with (output / "truth.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["frame", "split", *labels])
        for press in presses:
            (output / "frames" / press.name).symlink_to(press.picture.resolve())
            writer.writerow([press.name, press.split, *press.values])
    (output / "sensor.toml").write_text(sensor)
