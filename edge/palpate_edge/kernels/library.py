"""The library of the compiled kernels: loaded once, for the machine that runs, and from today's sources."""

from __future__ import annotations

import ctypes
import platform
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.errors import KernelsError

FOLDER = Path(__file__).parent
POINTER = ctypes.c_void_p


def kernel(name: str, *arguments: type) -> Callable[..., Any]:
    """Return the library's function `name`, which returns an int, or nothing.

    arguments: types of ctypes. Raises KernelsError where the library is missing or older than its sources.
    """
    function = _library().__getattr__(name)
    function.argtypes, function.restype = arguments, ctypes.c_int
    return function  # type: ignore[no-any-return]


def address(array: NDArray[Any], dtype: type[np.generic]) -> int:
    """Return where the numbers of an array lie. The caller keeps the array as long as the address is used.

    Raises TypeError for an array of another type, or whose numbers do not lie one behind the other.
    """
    if array.dtype != dtype or not array.flags.c_contiguous:
        raise TypeError(f"a kernel was given {array.dtype} where it needs contiguous {dtype.__name__}")
    return array.ctypes.data


@cache
def _library() -> ctypes.CDLL:
    path = FOLDER / f"{platform.machine()}.so"
    if not path.exists():
        machines = ", ".join(sorted(other.stem for other in FOLDER.glob("*.so"))) or "no machine"
        raise KernelsError(
            f"palpate's compiled kernels are missing for {platform.machine()} (they are there for {machines}): "
            "install palpate again, or run python hatch_build.py in its sources"
        )
    library = ctypes.CDLL(str(path))
    library.kernels_checksum.restype = ctypes.c_uint32
    sources = sorted(source for source in FOLDER.iterdir() if source.suffix in (".c", ".h"))
    if library.kernels_checksum() != zlib.crc32(b"".join(source.read_bytes() for source in sources)):
        raise KernelsError(
            f"palpate's compiled kernels {path} are not those of its sources: run python hatch_build.py there"
        )
    return library
