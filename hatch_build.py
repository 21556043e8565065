"""Compile the kernels (edge/palpate_edge/kernels/*.c) for the machines that palpate runs on.

Hatchling runs this for each wheel and for an editable installation; `python hatch_build.py` does it alone.
One compiler, Zig's from its wheel, makes the libraries of all machines on any of them: no board and no user
needs a compiler, and the same sources give the same bytes.
"""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path
from typing import Any

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # compiled alone
    BuildHookInterface = object

FOLDER = Path(__file__).resolve().parent / "edge" / "palpate_edge" / "kernels"
BUILT = "built"
"""Folder of the libraries beside their sources: Python would take them there for modules."""

TARGETS = {
    "x86_64": ("-target", "x86_64-linux-none", "-mcpu=x86_64_v2"),
    "x86_64_v3": ("-target", "x86_64-linux-none", "-mcpu=x86_64_v3"),
    "aarch64": ("-target", "aarch64-linux-none", "-mcpu=generic"),
}
"""Library -> the compiler's options: any x86-64 since 2009, with AVX2 (since about 2015), any aarch64."""

# No C library: the kernels only compute. NaN and infinity keep their meaning, since places may be NaN.
OPTIONS = """
-std=c11 -O3 -Wall -Wextra -Werror -ffreestanding -nostdlib -fPIC -fvisibility=hidden -shared -s
-fno-math-errno -fno-trapping-math -fassociative-math -freciprocal-math -fno-signed-zeros -ffp-contract=fast
-fno-sanitize=all -fno-stack-protector -Wl,--build-id=none
"""


def sources() -> list[Path]:
    """Return the C files, in the order in which their checksum is made."""
    return sorted(path for path in FOLDER.iterdir() if path.suffix in (".c", ".h"))


def checksum() -> int:
    """Return the checksum of the sources, which the library is asked for when it is loaded."""
    return zlib.crc32(b"".join(path.read_bytes() for path in sources()))


def compile_kernels() -> list[Path]:
    """Write the libraries of all machines and return their paths."""
    if importlib.util.find_spec("ziglang") is None:
        raise SystemExit("error: no compiler for the kernels: pip install -r requirements/kernels.lock")
    written = []
    code = [str(path) for path in sources() if path.suffix == ".c"]
    with tempfile.TemporaryDirectory() as cache:  # nothing is left in the user's home
        environment = os.environ | {"ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
        for machine, options in TARGETS.items():
            library = FOLDER / BUILT / f"{machine}.so"
            made = Path(cache) / library.name
            command = [sys.executable, "-m", "ziglang", "cc", *options, *OPTIONS.split()]
            command += [f"-DKERNELS_CHECKSUM={checksum()}u", "-o", str(made), *code]
            subprocess.run(command, check=True, env=environment)
            library.parent.mkdir(exist_ok=True)
            fresh = library.with_suffix(f".{os.getpid()}")  # tests and an installation may build at once
            fresh.write_bytes(made.read_bytes())
            fresh.replace(library)  # a process that has loaded the last one keeps it
            written.append(library)
    return written


class KernelsHook(BuildHookInterface):  # type: ignore[misc, valid-type, unused-ignore]
    """Compiles the kernels before anything is packed; all machines' libraries are in the one wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002 - hatchling's words
        """Compile; the libraries are added to what the wheel contains."""
        for library in compile_kernels():
            build_data["artifacts"].append(library.relative_to(Path(self.root)).as_posix())


if __name__ == "__main__":
    for path in compile_kernels():
        print(path)
