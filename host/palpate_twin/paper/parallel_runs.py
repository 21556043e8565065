"""Many runs side by side, each in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

Case = TypeVar("Case")
Result = TypeVar("Result")


def run_each(
    run: Callable[[Case], Result], cases: Sequence[Case], jobs: int, done: Callable[[], None]
) -> list[Result]:
    """Return `run` of each case, `jobs` at a time; order and results do not depend on `jobs`.

    run, cases and results have to be picklable unless `jobs` is 1, which runs them in this process. done:
    called after each run. Raises what a run raises.
    """
    if jobs == 1:
        results = []
        for case in cases:
            results.append(run(case))
            done()
        return results
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(run, case) for case in cases]
        for future in futures:
            future.add_done_callback(lambda _: done())
        return [future.result() for future in futures]
