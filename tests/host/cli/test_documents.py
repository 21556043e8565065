"""``palpate-host docs`` and ``palpate-host example``."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.config import read_config
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_host.cli.documents import EXAMPLES, docs, example
from palpate_host.config import hand_reader
from palpate_host.drives.az import config as az_config

ROOT = Path(__file__).resolve().parents[3]


def test_docs_lists_every_page_and_prints_one() -> None:
    listed = CliRunner().invoke(docs).output.splitlines()
    assert [line.split()[0] for line in listed] == sorted(path.stem for path in (ROOT / "docs").glob("*.md"))
    page = (ROOT / "docs" / "building.md").read_text()
    assert CliRunner().invoke(docs, ["building.md"]).output == page
    assert CliRunner().invoke(docs, ["building", "--path"]).output == f"{ROOT / 'docs' / 'building.md'}\n"
    with pytest.raises(ConfigError, match="palpate-host docs"):
        CliRunner().invoke(docs, ["nothing"], catch_exceptions=False)


def test_every_example_is_accepted_by_the_program_that_reads_it(tmp_path: Path) -> None:
    readers = {"az.toml": az_config.load, "finger.toml": read_config, "sensor.toml": read_sensor}
    for name in EXAMPLES:
        path = tmp_path / name
        done = CliRunner().invoke(example, [name, "-o", str(path)], catch_exceptions=False)
        assert done.exit_code == 0
        if name in readers or name.startswith("hand"):
            readers.get(name, hand_reader.load)(path)
    with pytest.raises(ConfigError, match="exists"):
        CliRunner().invoke(example, ["hand.toml", "-o", str(path)], catch_exceptions=False)
    with pytest.raises(ConfigError, match="give one of"):
        CliRunner().invoke(example, ["foot.toml"], catch_exceptions=False)
