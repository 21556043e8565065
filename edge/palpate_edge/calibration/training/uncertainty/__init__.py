"""Uncertainty of the correction model's answers, from presses left out in turn.

Belongs here: 95 % radii, half widths and upper limits, errors by region. May use: what training may use.
"""
