"""What grows or drifts in a long run: the closed loop in virtual time, then the demo in real time.

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
    """A line each minute, then what has changed between the first and the last quarter.

    loops: a tick in empty loops timed beside it, so that a processor that others slow down is no drift.
    """
    yield f"Closed loop, {duration_s:.0f} s of virtual time"
    yield "    min  tick median ms  p99 ms  loops  resident MB  bus frames  off deg  mode"
    seen: list[tuple[float, float, int]] = []  # a minute's end, loops, bytes; its ticks would be growth too
    for minute in soak_virtual.minutes(duration_s):
        loops = float(np.median(minute.tick_s) / np.median(minute.yardstick_s))
        seen.append((minute.end_s, loops, minute.resident_bytes))
        off_deg = minute.orientation_error_deg
        yield (
            f"{minute.end_s / 60:7.1f}  {1e3 * np.median(minute.tick_s):14.3f}"
            f"  {1e3 * np.percentile(minute.tick_s, 99):6.3f}  {loops:5.2f}"
            f"  {minute.resident_bytes / MB:11.1f}  {minute.bus_frames:10d}"
            f"  {'' if off_deg is None else f'{off_deg:.2f}':>7}  {minute.mode}"
        )
    if len(seen) >= 4:
        quarter = len(seen) // 4
        (first_s, first, first_bytes), (last_s, last, last_bytes) = (
            (part[-1][0], float(np.median([loops for _, loops, _ in part])), part[-1][2])
            for part in (seen[:quarter], seen[-quarter:])
        )
        yield (
            f"first to last quarter: tick {first:.2f} to {last:.2f} loops,"
            f" memory {(last_bytes - first_bytes) / MB:+.2f} MB in {(last_s - first_s) / 60:.0f} min"
        )


def real(duration_s: float) -> Iterator[str]:
    """Memory of each process at a third of the run and at its end, then the host's ticks by the minute."""
    memory, sync_s = soak_real.run(duration_s)
    yield f"The demo's processes, {duration_s:.0f} s of real time"
    yield f"{'':28}  a third MB   end MB  growth MB"
    for name, looks in sorted(memory.items()):
        _, bytes_ = np.array(looks, dtype=np.float64).T
        if len(looks) < 6:
            continue
        third, end = np.median(bytes_[len(looks) // 3 :][:3]) / MB, np.median(bytes_[-4:-1]) / MB
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
    parser.add_argument("--virtual-s", type=float, default=3600.0, help="virtual seconds; 0: none [3600]")
    parser.add_argument("--real-s", type=float, default=600.0, help="real seconds; 0: none [600]")
    given = parser.parse_args()
    for duration_s, report in ((given.virtual_s, virtual), (given.real_s, real)):
        if duration_s > 0:
            for line in report(duration_s):
                print(line)
                sys.stdout.flush()


if __name__ == "__main__":
    main()
