"""The names that `palpate_edge` exports, and what importing the package costs."""

from __future__ import annotations

import subprocess
import sys

import pytest

import palpate_edge


@pytest.mark.parametrize("name", palpate_edge.__all__)
def test_every_exported_name_is_there(name):
    assert getattr(palpate_edge, name).__name__ == name


def test_an_unknown_name_is_an_error():
    with pytest.raises(AttributeError, match="'palpate_edge' has no attribute 'Estimater'"):
        palpate_edge.Estimater  # noqa: B018


def test_importing_the_package_loads_no_library():
    program = "import sys, palpate_edge; print({'numpy', 'cv2', 'msgspec', 'canopen'} & set(sys.modules))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout == "set()\n"
