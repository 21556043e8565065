"""Measure memory growth and timing drift in long runs: closed loop in simulated time, demo in real time.

python -m bench.soak
python -m bench.soak --virtual-s 600 --real-s 60
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np

from bench import soak_real, soak_virtual

MB = 1e6


def virtual(duration_s: float) -> Iterator[str]:
    """Yield a line per minute, then the change from the first to the last quarter.

    loops: duration of a tick divided by that of an empty loop timed at the same time, which compensates for
    changes of the processor's speed.
    """
    yield f"Closed loop, {duration_s:.0f} s of simulated time"
    yield "    min  tick median ms  p99 ms  loops  resident MB  bus frames  error deg  mode"
    summary: list[tuple[float, float, int]] = []  # end of the minute, loops, bytes; ticks are not stored
    for minute in soak_virtual.minutes(duration_s):
        loops = float(np.median(minute.tick_s) / np.median(minute.reference_s))
        summary.append((minute.end_s, loops, minute.resident_bytes))
        error_deg = minute.orientation_error_deg
        yield (
            f"{minute.end_s / 60:7.1f}  {1e3 * np.median(minute.tick_s):14.3f}"
            f"  {1e3 * np.percentile(minute.tick_s, 99):6.3f}  {loops:5.2f}"
            f"  {minute.resident_bytes / MB:11.1f}  {minute.bus_frames:10d}"
            f"  {'' if error_deg is None else f'{error_deg:.2f}':>9}  {minute.mode}"
        )
    if len(summary) >= 4:
        quarter = len(summary) // 4
        (first_s, first, first_bytes), (last_s, last, last_bytes) = (
            (part[-1][0], float(np.median([loops for _, loops, _ in part])), part[-1][2])
            for part in (summary[:quarter], summary[-quarter:])
        )
        yield (
            f"first to last quarter: tick {first:.2f} to {last:.2f} loops,"
            f" memory {(last_bytes - first_bytes) / MB:+.2f} MB in {(last_s - first_s) / 60:.0f} min"
        )


def real(duration_s: float) -> Iterator[str]:
    """Yield the memory of each process at a third of the run and at its end, then the host's tick periods."""
    memory, sync_s = soak_real.run(duration_s)
    yield f"The demo's processes, {duration_s:.0f} s of real time"
    yield f"{'':28}  a third MB   end MB  growth MB"
    for name, samples in sorted(memory.items()):
        _, bytes_ = np.array(samples, dtype=np.float64).T
        if len(samples) < 6:
            continue
        third, end = np.median(bytes_[len(samples) // 3 :][:3]) / MB, np.median(bytes_[-4:-1]) / MB
        yield f"{name:28}  {third:10.1f}  {end:7.1f}  {end - third:+9.1f}"
    yield "minute  SYNCs  period median ms  p99 ms  longest ms"
    began_s = sync_s[0]
    for number in range(int((sync_s[-1] - began_s) // 60) + 1):
        inside = sync_s[(sync_s >= began_s + 60 * number) & (sync_s < began_s + 60 * (number + 1))]
        if len(inside) > 1:
            period_ms = 1e3 * np.diff(inside)
            yield (
                f"{number + 1:6d}  {len(inside):5d}  {np.median(period_ms):16.3f}"
                f"  {np.percentile(period_ms, 99):6.3f}  {period_ms.max():10.3f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.soak",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--virtual-s", type=float, default=3600.0, help="duration in simulated time in s; 0: skip [3600]"
    )
    parser.add_argument(
        "--real-s", type=float, default=600.0, help="duration in real time in s; 0: skip [600]"
    )
    arguments = parser.parse_args()
    for duration_s, report in ((arguments.virtual_s, virtual), (arguments.real_s, real)):
        if duration_s > 0:
            for line in report(duration_s):
                print(line)
                sys.stdout.flush()


if __name__ == "__main__":
    main()
