"""Timings with ratios against the alternatives: ``make bench``."""
