"""onnxruntime, loaded on first use and without its reports to its maker."""

from __future__ import annotations

import importlib
import os
from typing import Any


def load_onnxruntime() -> Any:
    """The module; raises ImportError where the extra ``palpate[onnx]`` is not installed.

    Its Linux wheels start a thread that reports their use over the network, unless this variable is set when
    the library is loaded (onnxruntime's Privacy.md).
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    return importlib.import_module("onnxruntime")
