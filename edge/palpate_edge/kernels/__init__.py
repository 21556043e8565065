"""Compiled kernels: the loops over beads, samples and blobs of every frame, in C, and their use from Python.

Each kernel is a C file and a Python module of the same name, which gives it arrays and takes its results; it may
use common alone.
"""
