"""The kernels, as parameters of a fixture; its tests run once in each kernel."""

import pytest

IN_A_KERNEL = (
    pytest.param("uml", marks=pytest.mark.uml),
    pytest.param("vm", marks=(pytest.mark.vm, pytest.mark.again)),
)
