"""Real-time scheduling of the host, as far as it is permitted: SCHED_FIFO and locked memory."""

from __future__ import annotations

import ctypes
import os

PRIORITY = 40  # below the kernel's interrupt threads, which have 50
MCL_CURRENT, MCL_FUTURE = 1, 2  # linux/mman.h


def become_real_time() -> list[str]:
    """Request both; return one line with the remedy for each refusal. A class set by systemd is kept."""
    refused = []
    if reason := request_fifo(PRIORITY):
        refused.append(f"no real-time class ({reason}): use systemd/palpate-host.service.d/real-time.conf")
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE) != 0:
        reason = os.strerror(ctypes.get_errno())
        refused.append(f"memory not locked ({reason}): raise LimitMEMLOCK= (ulimit -l)")
    return refused


def request_fifo(priority: int) -> str:
    """Request SCHED_FIFO for this thread and its later ones; return why it is refused, else an empty text."""
    if os.sched_getscheduler(0) != os.SCHED_FIFO:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError as exc:
            return exc.strerror or str(exc)
    return ""
