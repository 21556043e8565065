"""The library of the compiled kernels: loaded once, for the machine that runs, and from today's sources."""

from __future__ import annotations

import ctypes
import os
import zlib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.errors import KernelsError

FOLDER = Path(__file__).parent
BUILT = "built"
"""Folder of the libraries beside their sources: Python would take them there for modules."""
POINTER = ctypes.c_void_p
CPU_FLAGS = Path("/proc/cpuinfo")
LEVEL_3 = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"}
"""Flags of a processor that runs x86-64-v3 (System V ABI), as Linux names them."""


def kernel(name: str, *arguments: type) -> Callable[..., Any]:
    """Return the library's function `name`, which returns an int, or nothing.

    arguments: types of ctypes. Raises KernelsError where the library is missing or older than its sources.
    """
    function = _library().__getattr__(name)
    function.argtypes, function.restype = arguments, ctypes.c_int
    return function


def address(array: NDArray[Any], dtype: type[np.generic]) -> int:
    """Return where the numbers of an array lie. The caller keeps the array as long as the address is used.

    Raises TypeError for an array of another type, or whose numbers do not lie one behind the other.
    """
    if array.dtype != dtype or not array.flags.c_contiguous:
        raise TypeError(f"a kernel was given {array.dtype} where it needs contiguous {dtype.__name__}")
    if array.size and array.flags.writeable:
        # A quarter of the time of the last line. In Python 3.11 an array is no buffer to a type checker.
        buffer: Any = array
        return ctypes.addressof(ctypes.c_char.from_buffer(buffer))
    return array.ctypes.data


def addresses(arrays: Mapping[str, NDArray[Any]], dtype: type[np.generic]) -> dict[str, int]:
    """Return the address of each array, all of one type, by the name of its field in a structure."""
    return {name: address(array, dtype) for name, array in arrays.items()}


def checksum(folder: Path) -> int:
    """Return the checksum of the C sources in a folder, which the build compiles into the library."""
    sources = sorted(path for path in folder.iterdir() if path.suffix in (".c", ".h"))
    return zlib.crc32(b"".join(path.read_bytes() for path in sources))


def machine() -> str:
    """Return the name of this machine's library: its architecture, and on x86-64 the level if it has AVX2."""
    architecture = os.uname().machine
    if architecture != "x86_64":
        return architecture
    flags = set(CPU_FLAGS.read_text().split()) if CPU_FLAGS.exists() else set()
    return "x86_64_v3" if flags >= LEVEL_3 else architecture


@cache
def _library() -> ctypes.PyDLL:
    path = FOLDER / BUILT / f"{machine()}.so"
    if not path.exists():
        others = ", ".join(sorted(other.stem for other in (FOLDER / BUILT).glob("*.so"))) or "no machine"
        raise KernelsError(
            f"palpate's compiled kernels are missing for {machine()} (they are there for {others}): "
            "install palpate again, or run python hatch_build.py in its sources"
        )
    # A kernel takes a fraction of a millisecond: for that no other thread gets the interpreter, from which it
    # might come back only 5 ms later.
    try:
        library = ctypes.PyDLL(str(path))
    except OSError as error:
        raise KernelsError(
            f"palpate's compiled kernels cannot be loaded ({error}): palpate needs a 64-bit Python, on Linux"
        ) from None
    library.kernels_checksum.restype = ctypes.c_uint32
    if library.kernels_checksum() != checksum(FOLDER):
        raise KernelsError(
            f"palpate's compiled kernels {path} are not those of its sources: run python hatch_build.py there"
        )
    return library
