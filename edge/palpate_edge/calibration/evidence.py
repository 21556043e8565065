"""Mean of what several settings give, each by how probable it makes the data (Bayesian model averaging).

Few presses do not determine settings; the most probable one alone would be a matter of chance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate_edge.common.arrays import Array


def mean_by_evidence(
    log_evidences: Sequence[float], found: Sequence[tuple[Array, ...]]
) -> tuple[tuple[Array, ...], float]:
    """Return the means of what each setting found, and the logarithm of the sum of the evidences.

    log_evidences (m,): natural logarithms; found (m,): arrays of the same shapes from each setting.
    """
    largest = max(log_evidences)
    share = np.exp(np.array(log_evidences) - largest)
    total = float(share.sum())
    means = tuple(
        np.asarray(np.tensordot(share / total, np.array(each), axes=1)) for each in zip(*found, strict=True)
    )
    return means, largest + math.log(total)
