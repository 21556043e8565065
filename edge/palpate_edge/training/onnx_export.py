"""Regression -> ONNX: one graph, compared with numpy before it is given out.

Its numbers are float32 where that moves a contact by a few hundredths of a millimetre at most: half the
memory to read for every frame. A kernel expansion of many centres is a sum of terms that nearly cancel; where
its weights are so large that float32 does not do, they are float64. Each step costs more than its arithmetic,
so that offsets and levels stand in the matrices. What they are multiplied by are columns, on their right:
onnxruntime copies a matrix of float64 on the right before it multiplies, for every frame.
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
from palpate_edge.estimator import MAX_MISFIT
from palpate_edge.training.answer_field import FORCE_WEIGHT, LENGTH, PLACE_WEIGHT
from palpate_edge.training.answer_field import SIZE_WEIGHT as ANSWER_SIZE_WEIGHT
from palpate_edge.training.kernel_ridge import SIZE_WEIGHT, Regression

Array = NDArray[np.float64]

OPSET = 17
IR_VERSION = 8
PRECISIONS: dict[type[np.floating], int] = {np.float32: TensorProto.FLOAT, np.float64: TensorProto.DOUBLE}
MAX_DIRECTION_ERROR = 1e-3  # 0.03 mm on the paper's dome; usual is a sixth of it
MAX_MISFIT_ERROR = 0.02  # of estimator.MAX_MISFIT and the misfit together
MAX_FORCE_ERROR = 1e-2  # of the largest force; usual is a third of it


def export(regression: Regression, sensor_fingerprint: str, fields: Array) -> bytes:
    """The model file. Raises CalibrationError when it does not give what numpy gives on some of `fields`
    (s, 2 g)."""
    for precision in PRECISIONS:
        model = _graph(regression, sensor_fingerprint, precision)
        onnx.checker.check_model(model)
        data = bytes(model.SerializeToString())
        error = _error(data, regression, sensor_fingerprint, fields)
        if not error:
            return data
    raise CalibrationError(
        f"the exported model differs from the fitted one ({error}): more presses, or --no-model"
    )


def _graph(regression: Regression, sensor_fingerprint: str, precision: type[np.floating]) -> Any:
    """Kernels are exp(2 a c - |a|^2 - |c|^2) of points a and centres c over sqrt(2) times the length."""
    projection, answer_field = regression.projection, regression.answer_field
    point_scale = 1 / (np.sqrt(2) * regression.length)
    width, kept = projection.components.shape
    point_parts = np.zeros((kept + 2, width + 1))  # from shape and log size to the point, and a 1
    point_parts[:kept, :width] = point_scale * projection.components.T
    point_parts[kept, width] = point_scale * SIZE_WEIGHT
    point_origin = np.append(-point_scale * projection.mean @ projection.components, [0.0, 1.0])
    answer_weights = np.vstack([answer_field.weights.T, np.zeros(len(answer_field.weights))])
    answer_offset = np.append(answer_field.offset, 1.0)  # the 1 is for the mean shape
    hidden_slope = np.zeros((1, 7))
    hidden_slope[0, 6] = regression.hidden_slope
    constants = {
        "point_parts": point_parts,
        "point_origin": point_origin[:, None],
        "point_centres": _centres(point_scale * regression.centres),
        "weights": regression.weights,
        "offset": regression.offset[None],
        "hidden_slope": hidden_slope,
        "answer_parts": _answer_parts(),
        "answer_origin": np.eye(8)[:, 7:],
        "answer_centres": _centres(answer_field.centres / (np.sqrt(2) * LENGTH)),
        "answer_weights": answer_weights,
        "answer_offset": answer_offset[:, None],
        "shapes": np.column_stack([projection.components, projection.mean]),
    }
    initializers = [numpy_helper.from_array(v.astype(precision), k) for k, v in constants.items()]
    integers = {"parts": np.array([3, 3, 1]), "column": np.array([width, 1])}
    initializers += [numpy_helper.from_array(v.astype(np.int64), k) for k, v in integers.items()]
    node = helper.make_node
    nodes = [
        node("ReduceL2", ["field"], ["size"], axes=[1], keepdims=1),
        node("Div", ["field", "size"], ["shape_"]),
        node("Log", ["size"], ["log_size"]),
        node("Concat", ["shape_", "log_size"], ["parts_of_point"], axis=1),
        node("Gemm", ["point_parts", "parts_of_point", "point_origin"], ["point"], transB=1),
        *_kernel("point"),
        node("Gemm", ["hidden", "hidden_slope", "offset"], ["level"]),
        node("Gemm", ["point_kernel", "weights", "level"], ["raw"], transA=1),
        node("Split", ["raw", "parts"], ["direction_raw", "stiffness", "log_radius"], axis=1),
        node("LpNormalization", ["direction_raw"], ["direction"], axis=1, p=2),
        node("Mul", ["stiffness", "size"], ["force"]),
        node("Exp", ["log_radius"], ["radius95"]),
        # The way back (answer_field.py): what the answer's own field leaves of the given one.
        node("LpNormalization", ["stiffness"], ["force_way"], axis=1, p=2),
        node("Concat", ["direction", "force_way", "log_size"], ["parts_of_answer"], axis=1),
        node("Gemm", ["answer_parts", "parts_of_answer", "answer_origin"], ["answer"], transB=1),
        *_kernel("answer"),
        node("Gemm", ["answer_weights", "answer_kernel", "answer_offset"], ["answered"]),
        node("Reshape", ["shape_", "column"], ["shape_column"]),
        node("Gemm", ["shapes", "answered", "shape_column"], ["left"], alpha=-1.0),
        node("ReduceSumSquare", ["left"], ["misfit"], axes=[0], keepdims=1),
    ]

    def tensor(name: str, shape: list[int]) -> Any:
        return helper.make_tensor_value_info(name, PRECISIONS[precision], shape)

    graph = helper.make_graph(
        nodes,
        "palpate-correction",
        [tensor("field", [1, width]), tensor("hidden", [1, 1])],
        [
            tensor("direction", [1, 3]),
            tensor("force", [1, 3]),
            tensor("radius95", [1, 1]),
            tensor("misfit", [1, 1]),
        ],
        initializers,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(model, {SENSOR_KEY: sensor_fingerprint})
    return model


def _answer_parts() -> Array:
    """(8, 7): from direction, the force's way and the log size to answer_field.answers, scaled; the last
    row is for a 1."""
    parts = np.zeros((8, 7))
    parts[:3, :3] = PLACE_WEIGHT * np.eye(3)
    parts[3:6, :3] = parts[3:6, 3:6] = FORCE_WEIGHT * np.eye(3)
    parts[6, 6] = ANSWER_SIZE_WEIGHT
    return np.asarray(parts / (np.sqrt(2) * LENGTH))


def _centres(scaled: Array) -> Array:
    """(c, d + 1) of centres (c, d) over sqrt(2) times the kernel's length: what multiplies a point and a 1
    after it. The 1 is in the point's square, and is taken off again here."""
    return np.column_stack([2 * scaled, 1.0 - (scaled**2).sum(axis=1)])


def _kernel(point: str) -> list[Any]:
    """Gaussian kernel `point`_kernel (c, 1) of the point (d, 1) with `point`_centres (c, d)."""
    node = helper.make_node
    return [
        node("ReduceSumSquare", [point], [f"{point}_squared"], axes=[0], keepdims=1),
        node("Gemm", [f"{point}_centres", point, f"{point}_squared"], [f"{point}_exponent"], beta=-1.0),
        node("Exp", [f"{point}_exponent"], [f"{point}_kernel"]),
    ]


def _error(data: bytes, regression: Regression, sensor_fingerprint: str, fields: Array) -> str:
    """By how much the file differs from numpy in float64 on some samples; empty when hardly."""
    session = CorrectionModel(data, sensor_fingerprint)
    fields = fields[np.linspace(0, len(fields) - 1, 20).astype(int)]
    hidden = np.linspace(0.0, 0.3, len(fields))
    direction, force, _ = regression.predict(fields, hidden)
    got = [
        session.correct(CanonicalField(field, 0.0, float(share)))
        for field, share in zip(fields, hidden, strict=True)
    ]
    off = np.abs([answer.direction for answer in got] - direction).max()
    force_off = np.abs([answer.force_N for answer in got] - force).max() / np.linalg.norm(force, axis=1).max()
    misfit = regression.misfit(fields)
    misfit_off = (np.abs([answer.misfit for answer in got] - misfit) / (MAX_MISFIT + misfit)).max()
    if off <= MAX_DIRECTION_ERROR and force_off <= MAX_FORCE_ERROR and misfit_off <= MAX_MISFIT_ERROR:
        return ""
    return f"direction {off:.1e}, force {force_off:.1e} of the largest, misfit {misfit_off:.1e}"
