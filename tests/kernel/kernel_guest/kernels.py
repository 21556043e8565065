"""The kernels, as parameters of a fixture whose tests run once in each, beside those that need none."""

import pytest

IN_A_KERNEL = (
    pytest.param("uml", marks=pytest.mark.uml),
    pytest.param("vm", marks=(pytest.mark.vm, pytest.mark.again)),
)
