"""The guide's files: the dataset that it fills picture by picture, and the calibration it ends with."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from palpate_edge.calibration.calibrate import Progress, calibrate
from palpate_edge.calibration.calibration_file import save_calibration
from palpate_edge.common.atomic_write import make_folder, write_atomically
from palpate_edge.common.errors import ConfigError, DatasetError, reason_of
from palpate_edge.common.picture_file import write_picture
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.datasets.images import list_images
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_edge.datasets.weights_table import WEIGHTS, read_weight_rows, weights_text
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.guide.calibration_guide import CalibrationGuide, FitCalibration, SavePress, SaveReference
from palpate_edge.guide.report_picture import report_svg
from palpate_edge.jig.jig_table import JIG, read_jig_table

REFERENCE = "reference"


class GuideFiles:
    """folder: a press dataset with a sensor.toml; calibration: the file to write."""

    def __init__(self, folder: Path, calibration: Path) -> None:
        self.folder, self.calibration = folder, calibration

    @property
    def report(self) -> Path:
        """The picture of the result, beside the calibration."""
        return self.calibration.with_suffix(".svg")

    def open_guide(self) -> CalibrationGuide:
        """Return a guide that goes on where the folder's files end. Raises DatasetError."""
        sensor = read_sensor(self.folder / "sensor.toml")
        reference, weights = self.folder / REFERENCE, self.folder / WEIGHTS
        references = len(list_images(reference)) if reference.is_dir() and any(reference.iterdir()) else 0
        rows = read_weight_rows(weights) if references and weights.exists() else []
        frames = self.folder / "frames"
        names = [path.name for path in frames.iterdir()] if frames.is_dir() else []
        jig = self.folder / JIG
        holes = read_jig_table(jig) if jig.exists() else ()
        return CalibrationGuide(sensor, references, rows, names, holes)

    def save_reference(self, work: SaveReference) -> None:
        """Write the reference frames; keep earlier ones, and the weights of their time, under other names."""
        reference = self.folder / REFERENCE
        for path in (reference, self.folder / WEIGHTS):
            if path.exists():
                _keep(path)
        make_folder(reference, DatasetError)
        for number, image in enumerate(work.images):
            write_picture(reference / f"{number:03}.png", image, DatasetError)

    def save_press(self, work: SavePress) -> None:
        """Write the picture of a press, then the table of all presses."""
        if work.image is not None:
            make_folder(self.folder / "frames", DatasetError)
            write_picture(self.folder / "frames" / work.name, work.image, DatasetError)
        write_atomically(self.folder / WEIGHTS, weights_text(work.rows).encode(), DatasetError)

    def fit(self, work: FitCalibration, progress: Progress) -> Calibration:
        """Fit a calibration, and write it when it is the result. Raises CalibrationError or DatasetError."""
        from palpate_edge.calibration.training.dome_model import load_dome_model  # noqa: PLC0415 - extra `train`

        dataset = read_dataset(self.folder)
        if not work.with_presses:
            dataset = replace(dataset, presses=())
        trainable = all(find_spec(name) for name in ("onnx", "onnxruntime"))
        calibration = calibrate(dataset, progress, dome=load_dome_model() if trainable else None)
        if work.with_presses:
            if self.calibration.exists():
                _keep(self.calibration)
            save_calibration(calibration, self.calibration)
            write_atomically(self.report, report_svg(calibration).encode(), DatasetError)
        return calibration


def configured_files(config: FingertipConfig) -> GuideFiles:
    """Return the files of a fingertip: the folder of its sensor.toml, and its calibration.

    Raises ConfigError when the configuration does not name them.
    """
    sensor, calibration = config.estimator.sensor, config.estimator.calibration
    if not sensor or not calibration:
        missing = "estimator.sensor" if not sensor else "estimator.calibration"
        raise ConfigError(
            f"{config.name}: {missing} is not set: make a configuration with palpate-edge setup"
        )
    return GuideFiles(Path(sensor).parent, Path(calibration))


def _keep(path: Path) -> None:
    """Give a file or folder a free name beside it."""
    number = 1
    while (other := path.with_name(f"{path.stem}.{number}{path.suffix}")).exists():
        number += 1
    try:
        path.rename(other)
    except OSError as error:
        raise DatasetError(f"{path}: {reason_of(error)}; rename it to {other.name}") from None
