"""Kernels of their own for tests that need one: boot it, run tests inside, bring the outcomes back.

A test marked ``uml`` runs inside user-mode Linux, one marked ``vm`` inside a virtual machine. pytest outside
collects it as any other test; `forwarding` sends it in and reports what came out.
"""
