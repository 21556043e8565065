"""Files of one kind that several threads read at once, the first ones of their process."""

from __future__ import annotations

import subprocess
import sys

READ_AT_ONCE = """
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier
import msgspec
from palpate_edge.common.config_file import decode_json, parse_toml

sys.setswitchinterval(1e-6)
decode = {
    "json": lambda kind: decode_json(b'{"inner": {"k0": 1}}', kind, "here", guide=""),
    "toml": lambda kind: parse_toml(b"inner = {k0 = 1}", Path("here"), kind, guide=""),
}[sys.argv[1]]
with ThreadPoolExecutor(4) as pool:
    for number in range(100):
        keys = [(f"k{key}", float, 1.0) for key in range(40)]
        kind = msgspec.defstruct("Outer", [("inner", msgspec.defstruct("Inner", keys))])
        together = Barrier(4)
        read = list(pool.map(lambda _: (together.wait(), decode(kind))[1].inner.k0, range(4)))
        assert read == [1.0] * 4
"""


def test_types_that_threads_meet_at_once_are_prepared_once():
    """Without the lock msgspec ends the process by a segmentation fault."""
    for text in ("json", "toml"):
        command = [sys.executable, "-c", READ_AT_ONCE, text]
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stderr
