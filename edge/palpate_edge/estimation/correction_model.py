"""The correction model: canonical displacement field -> contact position, force and uncertainty, by ONNX.

The network file is made by ``training/``; it is one graph: normalise, project, kernel expansion, denormalise.
Inputs ``field`` (1, 2 g) mm and ``hidden`` (1, 1); outputs ``direction`` (1, 3) of the contact point and
``force`` (1, 3) N, both in the canonical frame, ``radius95`` (1, 1) mm and ``misfit`` (1, 1). A model of
presses with forces also has ``force95`` (1, 1) N, one of presses with torsions ``torsion`` and ``torsion95``
(1, 1) N mm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.contact import Vector3
from palpate_edge.common.errors import CalibrationError
from palpate_edge.common.onnx_runtime import load_onnxruntime
from palpate_edge.estimation.displacement_field import CanonicalField

OUTPUTS = ("direction", "force", "radius95", "misfit")
FORCE_OUTPUTS, TORSION_OUTPUTS = ("force95",), ("torsion", "torsion95")
KNOWN_OUTPUTS = tuple(
    OUTPUTS + force + torsion for force in ((), FORCE_OUTPUTS) for torsion in ((), TORSION_OUTPUTS)
)
NUMBERS = {"tensor(float)": np.float32, "tensor(double)": np.float64}
SENSOR_KEY = "palpate_sensor"  # metadata of the ONNX file


class Correction(msgspec.Struct, frozen=True):
    """direction of the contact point, unit vector in F; force_N on the dome in F; radius95_mm:
    with 95 % probability the contact is no farther from the given point; misfit: squared
    distance of the field to the one that a contact with this answer makes, both of size 1;
    force95_N: with 95 % probability the true force is no farther from force_N; torsion_Nmm: about the inward
    normal, torsion95_Nmm: half width of its 95 % interval; None where the model does not give them."""

    direction: Vector3
    force_N: Vector3
    radius95_mm: float
    misfit: float
    force95_N: float | None = None
    torsion_Nmm: float | None = None
    torsion95_Nmm: float | None = None


class CorrectionModel:
    """An ONNX session on one thread that does not spin."""

    def __init__(self, model: bytes, sensor_fingerprint: str) -> None:
        """Raises CalibrationError when onnxruntime is missing, the file is damaged or of another sensor."""
        try:
            onnxruntime = load_onnxruntime()
        except ImportError:
            raise CalibrationError(
                "the calibration holds a correction model, which needs onnxruntime: "
                "pip install 'palpate[onnx]', or choose the method paper"
            ) from None
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        options.log_severity_level = 3
        try:
            self._session: Any = onnxruntime.InferenceSession(
                model, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # noqa: BLE001 - onnxruntime raises a class a status code, none public
            raise CalibrationError(
                f"the correction model is damaged ({type(error).__name__}): run palpate-edge calibrate again"
            ) from None
        made_for = self._session.get_modelmeta().custom_metadata_map.get(SENSOR_KEY, "no sensor")
        if made_for != sensor_fingerprint:
            raise CalibrationError(
                f"the correction model was made for sensor {made_for}, the calibration is for "
                f"{sensor_fingerprint}: run palpate-edge calibrate again"
            )
        if tuple(output.name for output in self._session.get_outputs()) not in KNOWN_OUTPUTS:
            raise CalibrationError(
                "the correction model was made by another version: run palpate-edge calibrate again"
            )
        self._bind(onnxruntime.OrtValue.ortvalue_from_numpy)

    def _bind(self, tensor: Callable[[NDArray[np.floating]], Any]) -> None:
        """Give the session its inputs' and outputs' memory once: it shares that of numpy's arrays."""
        self._binding: Any = self._session.io_binding()
        self._arrays = {}
        for part, bind in (
            (self._session.get_inputs(), self._binding.bind_ortvalue_input),
            (self._session.get_outputs(), self._binding.bind_ortvalue_output),
        ):
            for value in part:
                self._arrays[value.name] = np.zeros(value.shape, NUMBERS[value.type])
                bind(value.name, tensor(self._arrays[value.name]))

    def correct(self, field: CanonicalField) -> Correction:
        """Contact position, force and uncertainty of one frame."""
        arrays = self._arrays
        arrays["field"][0] = field.values
        arrays["hidden"][0] = field.hidden
        self._session.run_with_iobinding(self._binding)
        # Plain floats: numpy takes longer to look at three numbers than to compute with them.
        cos, sin = math.cos(field.azimuth_rad), math.sin(field.azimuth_rad)
        x, y, z = arrays["direction"][0].tolist()
        x_N, y_N, z_N = arrays["force"][0].tolist()
        length = math.hypot(x, y, z)
        return Correction(
            ((cos * x - sin * y) / length, (sin * x + cos * y) / length, z / length),
            (cos * x_N - sin * y_N, sin * x_N + cos * y_N, z_N),
            float(arrays["radius95"][0, 0]),
            max(0.0, float(arrays["misfit"][0, 0])),
            self._given("force95"),
            self._given("torsion"),
            self._given("torsion95"),
        )

    def _given(self, output: str) -> float | None:
        """Return an output (1, 1) that not every model has."""
        values = self._arrays.get(output)
        return None if values is None else float(values[0, 0])
