"""Gzipped logs are unpacked within bounds: a small file must not fill the memory."""

from __future__ import annotations

import gzip

import pytest

from palpate_bus.logs.candump import LogError
from palpate_bus.logs.log_files import MAX_GZIP_RATIO, SMALL_LOG_BYTES, read_any_log

LINE = b"(1700000000.000000) can0 080#\n"


def test_a_file_that_unpacks_to_hundreds_of_times_its_size_is_refused(tmp_path):
    path = tmp_path / "bomb.log.gz"
    path.write_bytes(gzip.compress(LINE * (SMALL_LOG_BYTES // len(LINE) + 1)))
    assert path.stat().st_size * MAX_GZIP_RATIO < SMALL_LOG_BYTES
    with pytest.raises(LogError, match=r"unpack to more than 16 MiB: unpack it with gzip"):
        read_any_log(path)


def test_a_small_log_of_equal_lines_is_read(tmp_path):
    path = tmp_path / "quiet.log.gz"
    path.write_bytes(gzip.compress(LINE * 10_000))
    assert path.stat().st_size * MAX_GZIP_RATIO < 10_000 * len(LINE)
    assert len(read_any_log(path).records) == 10_000
