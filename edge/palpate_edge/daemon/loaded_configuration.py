"""A digest of what a fingertip has loaded: its configuration and the files that it names."""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec

from palpate_edge.daemon.config import FingertipConfig


def configuration_digest(config: FingertipConfig) -> str:
    """Return the SHA-256, hex, over the configuration and the content of calibration and sensor file.

    A file that is not named or does not exist counts as empty. The daemon calls this before it loads the
    files: if they are replaced meanwhile, its digest differs from theirs, and it is restarted once too often.
    """
    digest = hashlib.sha256(msgspec.json.encode(config))
    for name in (config.estimator.calibration, config.estimator.sensor):
        path = Path(name)
        content = path.read_bytes() if name and path.is_file() else b""
        digest.update(f"{len(content)} ".encode() + content)
    return digest.hexdigest()
