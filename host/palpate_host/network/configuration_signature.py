"""The configuration signature in 1020h (CiA 301): a node that has it is not read again object by object.

The signature is a digest of everything that the host compares, written as the date and time that CiA 301
prescribes. A node that can save (1010h) keeps it and sets it to 0 when one of its parameters changes; a node
with another calibration, software, serial number or node id has another one, or none.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable, Iterator

from palpate_edge.node.object_store import SIGNATURE_KEYS
from palpate_edge.node.stored_parameters import SIGNATURES, STORE
from palpate_host.drives.drive_settings import Write
from palpate_host.network.node_contract import Wanted

LAST_DAY = 0xFFFF  # of TIME_OF_DAY, days since 1984-01-01
DAY_MS = 86_400_000
SAVE_COMMUNICATION = (STORE, 2)  # 1020h is a communication object
SAVES_ON_COMMAND = 1  # bit of 1010h (CiA 301, 7.5.2.13)
_WRITTEN, _ABORT = 0x60, 0x80


def signature_of(contract: Iterable[Wanted]) -> tuple[Wanted, Wanted]:
    """Return both objects of 1020h with the values that stand for a node which agrees with `contract`.

    The date is never 0, which stands for a changed configuration.
    """
    lines = ((w.key, w.value, w.mask, w.need.name, w.pdo) for w in contract)
    date, time = struct.unpack("<QQ16x", hashlib.sha256(repr(list(lines)).encode()).digest())
    values = (1 + date % LAST_DAY, time % DAY_MS)
    first, second = (Wanted(key, value, "") for key, value in zip(SIGNATURE_KEYS, values, strict=True))
    return first, second


def signing(signature: Iterable[Wanted]) -> Iterator[Write]:
    """Yield the downloads that write and save a signature."""
    for wanted in signature:
        assert isinstance(wanted.value, int)
        yield Write(*wanted.key, 4, wanted.value, "signature of the configuration")
    yield Write(*SAVE_COMMUNICATION, 4, SIGNATURES[STORE], "signature of the configuration")


def is_written(write: Write, response: bytes) -> bool | None:
    """Return whether the node confirms the download; None for a response to another request."""
    if len(response) != 8 or struct.unpack_from("<HB", response, 1) != write.key:
        return None
    return {_WRITTEN: True, _ABORT: False}.get(response[0])
