"""Kernels of their own for tests that need one: boot it, run tests inside, bring the outcomes back.

A test marked ``uml`` runs inside user-mode Linux. pytest outside collects it as any other test; `forwarding`
sends it in and reports what came out.
"""

import pytest

# Parameters of a fixture whose tests run once in each kernel, beside those that need none.
IN_A_KERNEL = (pytest.param("uml", marks=pytest.mark.uml),)
