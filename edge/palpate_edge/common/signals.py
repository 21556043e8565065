"""Signal handlers: SIGTERM and SIGINT stop; three more control a running fingertip."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

STOP_SIGNALS = (signal.SIGTERM, signal.SIGINT)
RECORD, RECORD_NO_MORE, IDENTIFY = signal.SIGUSR1, signal.SIGUSR2, signal.SIGRTMIN


@contextmanager
def called_by_signals(calls: Mapping[signal.Signals, Callable[[], None]]) -> Iterator[None]:
    """Install signal handlers; restore the previous ones on exit."""
    former = {number: signal.signal(number, lambda *_, call=call: call()) for number, call in calls.items()}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


@contextmanager
def on_stop_signal(stop: Callable[[], None]) -> Iterator[None]:
    """Call `stop` on SIGTERM and SIGINT."""
    with called_by_signals(dict.fromkeys(STOP_SIGNALS, stop)):
        yield


@contextmanager
def stop_event() -> Iterator[threading.Event]:
    """Yield an event that SIGTERM and SIGINT set."""
    stopped = threading.Event()
    with on_stop_signal(stopped.set):
        yield stopped
