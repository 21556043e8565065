"""Timings with ratios against the alternatives: ``make bench``."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: times are one core's
