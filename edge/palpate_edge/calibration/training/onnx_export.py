"""Regression -> ONNX: one graph, compared with numpy before it is given out.

Its numbers are float32 where that moves a contact by a few hundredths of a millimetre at most: half the
memory to read for every frame. A kernel expansion of many centres is a sum of large terms that nearly cancel,
most of it in the kernels' constant and linear parts. These are summed here; the graph has what is left of
exp(2 h) - 1 - 2 h = 2 (tanh h / (1 - tanh h) - h), a form that keeps small numbers whole. Where the weights
are so large that this does not do, numbers are float64. Each step costs more than its arithmetic, so that
offsets and levels stand in the matrices; constant ones are on the right of a product, where onnxruntime lays
them out once. Needs the extra train.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from palpate_edge.calibration.training.answer_field import LENGTH
from palpate_edge.calibration.training.kernel_ridge import Regression
from palpate_edge.calibration.training.uncertainty.interval import Interval
from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.contact_fit.contact_fields import FORCE_WEIGHT, PLACE_WEIGHT, SIZE_WEIGHT
from palpate_edge.estimation.contact_validation import MAX_MISFIT
from palpate_edge.estimation.correction_model import (
    FORCE_OUTPUTS,
    OUTPUTS,
    SENSOR_KEY,
    TORSION_OUTPUTS,
    CorrectionModel,
)
from palpate_edge.estimation.displacement_field import CanonicalField

LEVEL = 0.25  # after each point, to multiply what is the same for all points; of their own size
OPSET = 17
IR_VERSION = 8
PRECISIONS: dict[type[np.floating], int] = {np.float32: TensorProto.FLOAT, np.float64: TensorProto.DOUBLE}
MAX_DIRECTION_ERROR = 1e-3  # 0.03 mm on the paper's dome; usual is a seventh of it
MAX_MISFIT_ERROR = 0.02  # of contact_validation.MAX_MISFIT and the misfit together
MAX_FORCE_ERROR = 1e-2  # of the largest force; usual is an eighth of it


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
    """Kernels are exp(2 h), h = 2 a c - |a|^2 - |c|^2 of points a and centres c over 2 times the length."""
    projection, answer_field = regression.projection, regression.answer_field
    point_scale = 1 / (2 * regression.length)
    width, kept = projection.components.shape
    metric = point_scale * projection.metric
    point_parts = np.vstack([projection.components @ metric[:kept], metric[kept:]])
    # From shape and log size to the point, and the level.
    point_parts = np.column_stack([point_parts, np.zeros(width + 1)])
    origin = np.append(-projection.mean @ projection.components, -projection.log_size) @ metric
    point_origin = np.append(origin, LEVEL)
    answer_weights = np.column_stack([2 * answer_field.weights, np.zeros(len(answer_field.weights))])
    answer_offset = np.append(answer_field.offset + answer_field.weights.sum(axis=0), 1.0)  # for the mean
    fitted, offset, outputs = regression.weights, regression.offset, list(OUTPUTS)
    if regression.torsion_weights is not None:
        fitted, offset = np.column_stack([fitted, regression.torsion_weights]), np.append(offset, 0.0)
    point_centres, weights = _centres(point_scale * regression.centres), 2 * fitted
    level_parts = np.vstack([point_centres @ weights, -weights.sum(axis=0), np.zeros(len(offset))])
    level_parts[-1, 6] = regression.hidden_slope
    constants = {
        "one": np.array(1.0),
        "point_parts": point_parts,
        "point_origin": point_origin[None],
        "point_centres": point_centres,
        "weights": weights,
        "offset": (offset + fitted.sum(axis=0))[None],
        "level_parts": level_parts,
        "answer_parts": _answer_parts(),
        "answer_origin": LEVEL * np.eye(8)[7:],
        "answer_centres": _centres(answer_field.centres / (2 * LENGTH)),
        "answer_weights": answer_weights,
        "answer_offset": answer_offset[None],
        "shapes": np.vstack([projection.components.T, projection.mean]),
    }
    node = helper.make_node
    raw_parts, further = ["direction_raw", "stiffness", "log_radius"], []
    if regression.force95 is not None:
        further += _interval("force95", regression.force95, constants)
        outputs += FORCE_OUTPUTS
    if regression.torsion_weights is not None and regression.torsion95 is not None:
        raw_parts.append("lever")
        further += [
            node("Mul", ["lever", "size"], ["torsion"]),
            *_interval("torsion95", regression.torsion95, constants),
        ]
        outputs += TORSION_OUTPUTS
    initializers = [numpy_helper.from_array(v.astype(precision), k) for k, v in constants.items()]
    initializers.append(numpy_helper.from_array(np.array([3, 3, 1, 1][: len(raw_parts)]), "parts"))
    nodes = [
        node("ReduceL2", ["field"], ["size"], axes=[1], keepdims=1),
        node("Div", ["field", "size"], ["shape_"]),
        node("Log", ["size"], ["log_size"]),
        node("Concat", ["shape_", "log_size"], ["parts_of_point"], axis=1),
        node("Gemm", ["parts_of_point", "point_parts", "point_origin"], ["point"]),
        *_kernel("point"),
        node("Sub", ["point_kernel", "point_half"], ["point_bend"]),
        node("Concat", ["point", "point_squared", "hidden"], ["parts_of_level"], axis=1),
        node("Gemm", ["parts_of_level", "level_parts", "offset"], ["level"]),
        node("Gemm", ["point_bend", "weights", "level"], ["raw"]),
        node("Split", ["raw", "parts"], raw_parts, axis=1),
        node("LpNormalization", ["direction_raw"], ["direction"], axis=1, p=2),
        node("Mul", ["stiffness", "size"], ["force"]),
        node("Exp", ["log_radius"], ["radius95"]),
        # The way back (answer_field.py): what the answer's own field leaves of the given one.
        node("LpNormalization", ["stiffness"], ["force_way"], axis=1, p=2),
        node("Concat", ["direction", "force_way", "log_size"], ["parts_of_answer"], axis=1),
        node("Gemm", ["parts_of_answer", "answer_parts", "answer_origin"], ["answer"]),
        *_kernel("answer"),  # as it is: its weights are a thousandth of the point's
        node("Gemm", ["answer_kernel", "answer_weights", "answer_offset"], ["answered"]),
        node("Gemm", ["answered", "shapes", "shape_"], ["left"], alpha=-1.0),
        node("ReduceSumSquare", ["left"], ["misfit"], axes=[1], keepdims=1),
        *further,
    ]

    def tensor(name: str, shape: list[int]) -> Any:
        return helper.make_tensor_value_info(name, PRECISIONS[precision], shape)

    graph = helper.make_graph(
        nodes,
        "palpate-correction",
        [tensor("field", [1, width]), tensor("hidden", [1, 1])],
        [tensor(name, [1, 3 if name in {"direction", "force"} else 1]) for name in outputs],
        initializers,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    helper.set_model_props(model, {SENSOR_KEY: sensor_fingerprint})
    return model


def _interval(name: str, interval: Interval, constants: dict[str, Array]) -> list[Any]:
    """Nodes for a 95 % half width (1, 1), an output of this name; their constants are added."""
    constants[f"{name}_slopes"] = np.array([[interval.size_slope], [interval.hidden_slope]])
    constants[f"{name}_level"] = np.array([[interval.level]])
    node = helper.make_node
    return [
        node("Concat", ["log_size", "hidden"], [f"{name}_parts"], axis=1),
        node("Gemm", [f"{name}_parts", f"{name}_slopes", f"{name}_level"], [f"{name}_log"]),
        node("Exp", [f"{name}_log"], [name]),
    ]


def _answer_parts() -> Array:
    """(7, 8): from direction, the force's way and the log size to answer_field.answers, scaled; the last
    column is for the level."""
    parts = np.zeros((7, 8))
    parts[:3, :3] = PLACE_WEIGHT * np.eye(3)
    parts[:3, 3:6] = parts[3:6, 3:6] = FORCE_WEIGHT * np.eye(3)
    parts[6, 6] = SIZE_WEIGHT
    return np.asarray(parts / (2 * LENGTH))


def _centres(scaled: Array) -> Array:
    """(d + 1, c) of centres (c, d) over 2 times the kernel's length: what multiplies a point and the level
    after it. The level is in the point's square, and is taken off again here."""
    return np.vstack([2 * scaled.T, LEVEL - (scaled**2).sum(axis=1) / LEVEL])


def _kernel(point: str) -> list[Any]:
    """(1, c): half of the Gaussian kernel less 1, of the point (1, d) with `point`_centres (d, c)."""
    node = helper.make_node
    squared, half, tanh, rest = (f"{point}_{part}" for part in ("squared", "half", "tanh", "rest"))
    return [
        node("ReduceSumSquare", [point], [squared], axes=[1], keepdims=1),
        node("Gemm", [point, f"{point}_centres", squared], [half], beta=-1.0),
        node("Tanh", [half], [tanh]),
        node("Sub", ["one", tanh], [rest]),
        node("Div", [tanh, rest], [f"{point}_kernel"]),
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
    torsion_off = _torsion_error([answer.torsion_Nmm for answer in got], regression.torsions_Nmm(fields))
    misfit = regression.misfit(fields)
    misfit_off = (np.abs([answer.misfit for answer in got] - misfit) / (MAX_MISFIT + misfit)).max()
    small = force_off <= MAX_FORCE_ERROR and torsion_off <= MAX_FORCE_ERROR
    if off <= MAX_DIRECTION_ERROR and small and misfit_off <= MAX_MISFIT_ERROR:
        return ""
    return (
        f"direction {off:.1e}, force {force_off:.1e} and torsion {torsion_off:.1e} of the largest, "
        f"misfit {misfit_off:.1e}"
    )


def _torsion_error(got: list[float | None], expected: Array | None) -> float:
    """Largest difference of the torsions over the largest of them; 0 where none are learned."""
    if expected is None or not expected.any():
        return 0.0
    return float(np.abs(np.array(got, dtype=np.float64) - expected).max() / np.abs(expected).max())
