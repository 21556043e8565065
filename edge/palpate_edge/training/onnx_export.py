"""Regression -> ONNX: one graph, compared with numpy before it is given out.

Its numbers are float64: a kernel expansion of thousands of centres is a sum of large terms that nearly
cancel. In float32 the press sample's model was 0.2 mm off.
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
    answer_field = regression.answer_field
    constants = {
        "mean": regression.projection.mean[None],
        "components": regression.projection.components,
        "point_centres": regression.centres.T,
        "point_centres_squared": (regression.centres**2).sum(axis=1)[None],
        "weights": regression.weights,
        "offset": regression.offset[None],
        "size_weight": np.array([[SIZE_WEIGHT]]),
        "two": np.array([[2.0]]),
        "point_exponent": -0.5 / regression.lengths[None] ** 2,
        "answer_centres": answer_field.centres.T,
        "answer_centres_squared": (answer_field.centres**2).sum(axis=1)[None],
        "answer_exponent": np.array([[-0.5 / LENGTH**2]]),
        "answer_weights": answer_field.weights,
        "answer_offset": answer_field.offset[None],
        "place_weight": np.array([[PLACE_WEIGHT]]),
        "force_weight": np.array([[FORCE_WEIGHT]]),
        "answer_size_weight": np.array([[ANSWER_SIZE_WEIGHT]]),
        "slope": np.array([[regression.hidden_slope]]),
        "zero": np.array([[0.0]]),
    }
    slices = {"from0": [0], "from3": [3], "from6": [6], "to3": [3], "to6": [6], "to7": [7], "axis1": [1]}
    initializers = [numpy_helper.from_array(v.astype(np.float64), k) for k, v in constants.items()]
    initializers += [numpy_helper.from_array(np.array(v, dtype=np.int64), k) for k, v in slices.items()]
    node = helper.make_node
    nodes = [
        node("ReduceL2", ["field"], ["size"], axes=[1], keepdims=1),
        node("Div", ["field", "size"], ["shape_"]),
        node("Sub", ["shape_", "mean"], ["centred"]),
        node("MatMul", ["centred", "components"], ["projected"]),
        node("Log", ["size"], ["log_size"]),
        node("Mul", ["log_size", "size_weight"], ["weighted_size"]),
        node("Concat", ["projected", "weighted_size"], ["point"], axis=1),
        *_kernel("point"),
        node("MatMul", ["point_kernel", "weights"], ["sum_"]),
        node("Add", ["sum_", "offset"], ["raw"]),
        node("Slice", ["raw", "from0", "to3", "axis1"], ["direction_raw"]),
        node("ReduceL2", ["direction_raw"], ["direction_size"], axes=[1], keepdims=1),
        node("Div", ["direction_raw", "direction_size"], ["direction"]),
        node("Slice", ["raw", "from3", "to6", "axis1"], ["stiffness"]),
        node("Mul", ["stiffness", "size"], ["force"]),
        node("Slice", ["raw", "from6", "to7", "axis1"], ["log_radius"]),
        node("Mul", ["hidden", "slope"], ["hidden_part"]),
        node("Add", ["log_radius", "hidden_part"], ["log_radius95"]),
        node("Exp", ["log_radius95"], ["radius95"]),
        # The way back (answer_field.py): what the answer's own field leaves of the given one.
        node("ReduceL2", ["force"], ["force_size"], axes=[1], keepdims=1),
        node("Div", ["force", "force_size"], ["force_way"]),
        node("Add", ["force_way", "direction"], ["across"]),
        node("Mul", ["direction", "place_weight"], ["answer_place"]),
        node("Mul", ["across", "force_weight"], ["answer_force"]),
        node("Mul", ["log_size", "answer_size_weight"], ["answer_size"]),
        node("Concat", ["answer_place", "answer_force", "answer_size"], ["answer"], axis=1),
        *_kernel("answer"),
        node("MatMul", ["answer_kernel", "answer_weights"], ["answered_sum"]),
        node("Add", ["answered_sum", "answer_offset"], ["answered"]),
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


def _kernel(point: str) -> list[Any]:
    """Gaussian kernel `point`_kernel of the point with `point`_centres."""
    node = helper.make_node
    return [
        node("MatMul", [point, f"{point}_centres"], [f"{point}_dot"]),
        node("Mul", [f"{point}_dot", "two"], [f"{point}_two_dot"]),
        node("ReduceSumSquare", [point], [f"{point}_squared"], axes=[1], keepdims=1),
        node("Add", [f"{point}_squared", f"{point}_centres_squared"], [f"{point}_squares"]),
        node("Sub", [f"{point}_squares", f"{point}_two_dot"], [f"{point}_distance_raw"]),
        node("Max", [f"{point}_distance_raw", "zero"], [f"{point}_distance"]),
        node("Mul", [f"{point}_distance", f"{point}_exponent"], [f"{point}_scaled"]),
        node("Exp", [f"{point}_scaled"], [f"{point}_kernel"]),
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
