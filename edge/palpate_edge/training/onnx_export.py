"""Regression -> ONNX: one graph, compared with numpy before it is given out.

Its numbers are float64: a kernel expansion of many centres is a sum of large terms that nearly cancel. In
float32 the press sample's model was 0.2 mm off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from palpate_edge.correction import SENSOR_KEY, CorrectionModel
from palpate_edge.displacement import CanonicalField
from palpate_edge.errors import CalibrationError
from palpate_edge.training.answer_field import FORCE_WEIGHT, LENGTH, PLACE_WEIGHT
from palpate_edge.training.answer_field import SIZE_WEIGHT as ANSWER_SIZE_WEIGHT
from palpate_edge.training.kernel_ridge import SIZE_WEIGHT, Regression

Array = NDArray[np.float64]

OPSET = 17
IR_VERSION = 8
MAX_DIRECTION_ERROR = 1e-6
MAX_MISFIT_ERROR = 1e-6
MAX_FORCE_ERROR = 1e-6  # of the largest force


def export(regression: Regression, sensor_fingerprint: str, fields: Array) -> bytes:
    """The model file. Raises CalibrationError when it does not give what numpy gives on some of `fields`
    (s, 2 g)."""
    model = _graph(regression, sensor_fingerprint)
    onnx.checker.check_model(model)
    data = bytes(model.SerializeToString())
    _compare(data, regression, sensor_fingerprint, fields)
    return data


def _graph(regression: Regression, sensor_fingerprint: str) -> Any:
    """Kernels are exp(2 a c - |a|^2 - |c|^2) of points a and centres c over sqrt(2) times the length."""
    answer_field = regression.answer_field
    point_centres = regression.centres / (np.sqrt(2) * regression.length)
    answer_centres = answer_field.centres / (np.sqrt(2) * LENGTH)
    hidden_slope = np.zeros((1, 7))
    hidden_slope[0, 6] = regression.hidden_slope
    constants = {
        "mean": regression.projection.mean[None],
        "components": regression.projection.components,
        "point_scale": np.full((1, 1), 1 / (np.sqrt(2) * regression.length)),
        "size_weight": np.array([[SIZE_WEIGHT]]),
        "point_centres": 2 * point_centres.T,
        "point_level": -(point_centres**2).sum(axis=1)[None],
        "weights": regression.weights,
        "offset": regression.offset[None],
        "hidden_slope": hidden_slope,
        "answer_parts": _answer_parts(),
        "answer_centres": 2 * answer_centres.T,
        "answer_level": -(answer_centres**2).sum(axis=1)[None],
        "answer_weights": answer_field.weights,
        "answer_offset": answer_field.offset[None],
    }
    initializers = [numpy_helper.from_array(v.astype(np.float64), k) for k, v in constants.items()]
    initializers.append(numpy_helper.from_array(np.array([3, 3, 1], np.int64), "parts"))
    node = helper.make_node
    nodes = [
        node("ReduceL2", ["field"], ["size"], axes=[1], keepdims=1),
        node("Div", ["field", "size"], ["shape_"]),
        node("Sub", ["shape_", "mean"], ["centred"]),
        node("MatMul", ["centred", "components"], ["projected"]),
        node("Log", ["size"], ["log_size"]),
        node("Mul", ["log_size", "size_weight"], ["weighted_size"]),
        node("Concat", ["projected", "weighted_size"], ["whole_point"], axis=1),
        node("Mul", ["whole_point", "point_scale"], ["point"]),
        *_kernel("point"),
        node("Gemm", ["hidden", "hidden_slope", "offset"], ["level"]),
        node("Gemm", ["point_kernel", "weights", "level"], ["raw"]),
        node("Split", ["raw", "parts"], ["direction_raw", "stiffness", "log_radius"], axis=1),
        node("LpNormalization", ["direction_raw"], ["direction"], axis=1, p=2),
        node("Mul", ["stiffness", "size"], ["force"]),
        node("Exp", ["log_radius"], ["radius95"]),
        # The way back (answer_field.py): what the answer's own field leaves of the given one.
        node("LpNormalization", ["stiffness"], ["force_way"], axis=1, p=2),
        node("Concat", ["direction", "force_way", "log_size"], ["parts_of_answer"], axis=1),
        node("MatMul", ["parts_of_answer", "answer_parts"], ["answer"]),
        *_kernel("answer"),
        node("Gemm", ["answer_kernel", "answer_weights", "answer_offset"], ["answered"]),
        node("Sub", ["projected", "answered"], ["left"]),
        node("ReduceSumSquare", ["left"], ["left_squared"], axes=[1], keepdims=1),
        node("ReduceSumSquare", ["centred"], ["centred_squared"], axes=[1], keepdims=1),
        node("ReduceSumSquare", ["projected"], ["projected_squared"], axes=[1], keepdims=1),
        node("Sub", ["centred_squared", "projected_squared"], ["out_of_plane"]),
        node("Add", ["left_squared", "out_of_plane"], ["misfit"]),
    ]
    tensor = helper.make_tensor_value_info
    width = len(regression.projection.mean)
    graph = helper.make_graph(
        nodes,
        "palpate-correction",
        [tensor("field", TensorProto.DOUBLE, [1, width]), tensor("hidden", TensorProto.DOUBLE, [1, 1])],
        [
            tensor("direction", TensorProto.DOUBLE, [1, 3]),
            tensor("force", TensorProto.DOUBLE, [1, 3]),
            tensor("radius95", TensorProto.DOUBLE, [1, 1]),
            tensor("misfit", TensorProto.DOUBLE, [1, 1]),
        ],
        initializers,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(model, {SENSOR_KEY: sensor_fingerprint})
    return model


def _answer_parts() -> Array:
    """(7, 7): from direction, the force's way and the log size to answer_field.answers, scaled."""
    parts = np.zeros((7, 7))
    parts[:3, :3] = PLACE_WEIGHT * np.eye(3)
    parts[:3, 3:6] = parts[3:6, 3:6] = FORCE_WEIGHT * np.eye(3)
    parts[6, 6] = ANSWER_SIZE_WEIGHT
    return np.asarray(parts / (np.sqrt(2) * LENGTH))


def _kernel(point: str) -> list[Any]:
    """Gaussian kernel `point`_kernel of the point with `point`_centres."""
    node = helper.make_node
    return [
        node("Gemm", [point, f"{point}_centres", f"{point}_level"], [f"{point}_dot"]),
        node("ReduceSumSquare", [point], [f"{point}_squared"], axes=[1], keepdims=1),
        node("Sub", [f"{point}_dot", f"{point}_squared"], [f"{point}_exponent"]),
        node("Exp", [f"{point}_exponent"], [f"{point}_kernel"]),
    ]


def _compare(data: bytes, regression: Regression, sensor_fingerprint: str, fields: Array) -> None:
    """Run the file on some samples and compare with float64 numpy."""
    session = CorrectionModel(data, sensor_fingerprint)
    fields = fields[np.linspace(0, len(fields) - 1, 20).astype(int)]
    hidden = np.linspace(0.0, 0.3, len(fields))
    direction, force, _ = regression.predict(fields, hidden)
    misfit = regression.misfit(fields)
    largest = float(np.linalg.norm(force, axis=1).max())
    for row in range(len(fields)):
        got = session.correct(CanonicalField(fields[row], 0.0, float(hidden[row])))
        direction_error = float(np.abs(got.direction - direction[row]).max())
        force_error = float(np.abs(got.force_N - force[row]).max()) / largest
        misfit_error = abs(got.misfit - float(misfit[row]))
        if (
            misfit_error > MAX_MISFIT_ERROR
            or direction_error > MAX_DIRECTION_ERROR
            or force_error > MAX_FORCE_ERROR
        ):
            raise CalibrationError(
                f"the exported model differs from the fitted one (direction {direction_error:.1e}, force "
                f"{force_error:.1e} of the largest): more presses, or --no-model"
            )
