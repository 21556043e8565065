"""Fixtures of the tests that need a kernel of their own."""

from __future__ import annotations

import pytest

from kernel_guest import IN_A_KERNEL


@pytest.fixture(params=IN_A_KERNEL)
def kernel(request: pytest.FixtureRequest) -> str:
    """The kernel that a test runs in: whoever asks for this runs once in each."""
    return str(request.param)
