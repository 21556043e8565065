"""The token's file: of this user alone, and the same in the next run."""

from __future__ import annotations

import os
import stat

import pytest

from palpate_edge.common.errors import ConfigError
from palpate_edge.web.token_file import read_or_make_token


def test_the_file_is_the_users_alone_and_the_token_stays(tmp_path):
    path = tmp_path / "finger.token"
    former = os.umask(0)
    try:
        token = read_or_make_token(path)
    finally:
        os.umask(former)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert len(token) == 43
    assert read_or_make_token(path) == token
    assert read_or_make_token(tmp_path / "other.token") != token


def test_a_file_that_others_may_read_or_write_is_refused(tmp_path):
    path = tmp_path / "finger.token"
    read_or_make_token(path)
    for mode in (0o640, 0o604, 0o620):
        path.chmod(mode)
        with pytest.raises(ConfigError, match="mode 0600"):
            read_or_make_token(path)


def test_a_link_a_pipe_an_empty_file_and_a_missing_folder_are_refused(tmp_path):
    real, link, pipe, empty = (tmp_path / name for name in ("real", "link", "pipe", "empty"))
    read_or_make_token(real)
    link.symlink_to(real)
    os.mkfifo(pipe, 0o600)
    empty.touch(0o600)
    for path in (link, pipe, empty, tmp_path / "none" / "token"):
        with pytest.raises(ConfigError, match="token file"):
            read_or_make_token(path)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to make another user's file")
def test_a_file_of_another_user_is_refused(tmp_path):
    path = tmp_path / "finger.token"
    read_or_make_token(path)
    os.chown(path, 65534, 65534)
    with pytest.raises(ConfigError, match="this user's"):
        read_or_make_token(path)
