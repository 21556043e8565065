"""Run tests in a kernel of their own: boot it, run the tests inside, return the outcomes.

A test marked ``uml`` runs inside user-mode Linux, one marked ``vm`` inside a virtual machine. pytest outside
collects it as any other test; `forwarding` sends it in and reports what came out.
"""
