"""Make demo/recording from the shared press data: run once, the result is committed.

    .venv/bin/python demo/make_recording.py ../shared/data demo/recording

Three fingers' press sequences become VP9 videos with their truth; a subset of the press sample becomes the
dataset that the demo calibrates with. Needs ffmpeg (apt install ffmpeg).
"""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
from pathlib import Path

import cv2

FINGERS = ("finger-1", "finger-2", "finger-3")
PRESSES = 60
UNTOUCHED = 8
REFERENCES = 5
JPEG_QUALITY = 80
VP9_QUALITY = 18


def main() -> None:
    data, target = Path(sys.argv[1]), Path(sys.argv[2])
    shutil.rmtree(target, ignore_errors=True)
    copy_presses(data / "press-sample", target / "press")
    for finger in FINGERS:
        encode_sequence(data / "press-sequences" / finger, target / finger)
    size = sum(path.stat().st_size for path in target.rglob("*") if path.is_file())
    print(f"{target}: {size / 1e6:.2f} MB")


def copy_presses(source: Path, target: Path) -> None:
    """The first reference frames and train presses of a dataset, as grey JPEG."""
    copy_reference(source, target, REFERENCES)
    header, rows = read_rows(source / "truth.csv")
    train = [row for row in rows if row[1] == "train"]
    kept = [row for row in train if row[3]][:PRESSES] + [row for row in train if not row[3]][:UNTOUCHED]
    (target / "frames").mkdir()
    for row in kept:
        save_grey(source / "frames" / row[0], target / "frames" / row[0])
    write_rows(target / "truth.csv", header, kept)


def encode_sequence(source: Path, target: Path) -> None:
    """A sequence's frames as one video, its truth as it is."""
    copy_reference(source, target, 1)
    header, rows = read_rows(source / "truth.csv")
    listing = target / "list.txt"
    listing.write_text("".join(f"file '{(source / 'frames' / row[0]).resolve()}'\n" for row in rows))
    command = ["ffmpeg", "-v", "error", "-y", "-r", "30", "-f", "concat", "-safe", "0", "-i"]
    command += [str(listing), "-r", "30", "-pix_fmt", "yuv420p", "-c:v", "libvpx-vp9"]
    command += ["-crf", str(VP9_QUALITY), "-b:v", "0", "-cpu-used", "1", str(target / "frames.webm")]
    subprocess.run(command, check=True)
    listing.unlink()
    write_rows(target / "truth.csv", header, rows)


def copy_reference(source: Path, target: Path, count: int) -> None:
    (target / "reference").mkdir(parents=True)
    shutil.copyfile(source / "sensor.toml", target / "sensor.toml")
    for path in sorted((source / "reference").iterdir())[:count]:
        save_grey(path, target / "reference" / f"{path.stem}.jpg")


def save_grey(source: Path, target: Path) -> None:
    image = cv2.imread(str(source), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(target), image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def read_rows(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return header, rows


def write_rows(path: Path, header: list[str], rows: list[list[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])


if __name__ == "__main__":
    main()
