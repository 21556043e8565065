"""Compiled kernels: the loops over beads, samples and blobs of every frame, in C, and their use from Python.

A kernel is a C file and a Python module of its name, which gives it arrays and takes its results. It may use
common alone.
"""
