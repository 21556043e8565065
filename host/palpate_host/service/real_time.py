"""Real-time scheduling of the host, as far as it is permitted: SCHED_FIFO and locked memory."""

from __future__ import annotations

import ctypes
import os

PRIORITY = 40  # below the kernel's interrupt threads, which have 50
MCL_CURRENT, MCL_FUTURE = 1, 2  # linux/mman.h


def become_real_time() -> list[str]:
    """Request both; return one line with the remedy for each refusal. A class set by systemd is kept."""
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
