"""The digest of what a daemon has loaded changes with everything that a restart would load."""

from __future__ import annotations

from pathlib import Path

import pytest

from palpate_edge.daemon.config import read_config
from palpate_edge.daemon.loaded_configuration import configuration_digest

TEXT = """name = "finger-1"
[capture]
source = "recorded"
path = "presses"
[estimator]
calibration = "finger-1.cal"
[node]
id = 16
[bus]
interface = "palpate"
"""


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    (tmp_path / "finger-1.cal").write_text("{}")
    (tmp_path / "fingertip.toml").write_text(TEXT)
    return tmp_path / "fingertip.toml"


def test_a_comment_changes_nothing_and_a_value_does(config_file: Path) -> None:
    before = configuration_digest(read_config(config_file))
    config_file.write_text(f"# the same\n{TEXT}")
    assert configuration_digest(read_config(config_file)) == before
    config_file.write_text(TEXT.replace("16", "17"))
    assert configuration_digest(read_config(config_file)) != before


@pytest.mark.parametrize("content", [b"{ }", None])
def test_another_calibration_is_another_configuration(config_file: Path, content: bytes | None) -> None:
    calibration, config = config_file.with_name("finger-1.cal"), read_config(config_file)
    before = configuration_digest(config)
    calibration.unlink()
    if content is not None:
        calibration.write_bytes(content)
    assert configuration_digest(config) != before
