"""Regression of pose labels on the displacement of markers.

Belongs here: kernels and their metric, local regressions, networks, and the half widths of intervals. May
use: arrays and numpy; no dataset, no picture.
"""
