"""The loop ahead of everything else on its machine, as far as that is allowed: SCHED_FIFO, memory locked."""

from __future__ import annotations

import ctypes
import os

PRIORITY = 40  # below the kernel's interrupt threads, which have 50
MCL_CURRENT, MCL_FUTURE = 1, 2  # linux/mman.h


def become_real_time() -> list[str]:
    """Ask for both; returns what was refused, each with the way out. A class that systemd has set stays."""
    refused = []
    if os.sched_getscheduler(0) != os.SCHED_FIFO:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        except OSError as exc:
            refused.append(
                f"no real-time class ({exc.strerror}): use systemd/palpate-host.service.d/real-time.conf"
            )
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE) != 0:
        reason = os.strerror(ctypes.get_errno())
        refused.append(f"memory not locked ({reason}): raise LimitMEMLOCK= (ulimit -l)")
    return refused
