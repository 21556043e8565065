"""The verdict on a demo run: one sentence and what it rests on."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_twin.demo.analysis import Summary


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """is_good: nothing is to be explained. headline: one sentence. grounds: one line each."""

    is_good: bool
    headline: str
    grounds: tuple[str, ...]


def verdict(summary: Summary) -> RunVerdict:
    """Judge a run by its turns, its contacts and its torques."""
    faults: list[str] = []
    grounds: list[str] = []
    steps = summary.turn.steps if summary.turn is not None else ()
    for step in steps:
        grounds.append(f"{step.name}: {step.outcome}.")
        if step.verdict:
            faults.append(f"{step.name} {step.verdict.lower()}")
    for push in summary.pushes:
        grounds.append(f"{push.name}: {push.outcome}.")
        if not push.is_held:
            faults.append(f"{push.name} not held")
    for finger in summary.fingers:
        error = finger.position_error_mm
        if error is None:
            faults.append(f"{finger.name} published no contact")
            continue
        force = "" if finger.force_rmse_N is None else f", force {finger.force_rmse_N:.2f} N RMSE"
        lost = f"{finger.dropped} of {finger.frames} frames dropped, {finger.refused} rejected"
        grounds.append(
            f"{finger.name}: contact {error.mean:.2f} mm from the truth on average{force}; {lost}."
        )
        if finger.dropped:
            faults.append(f"{finger.name} dropped {finger.dropped} frames")
    above = sum(joint.over_limit for joint in summary.hand.joints)
    if above:
        faults.append(f"{above} torque commands were above their limit")
    else:
        grounds.append("No torque command was above its limit.")
    done = "The programs ran without a fault"
    if steps:
        turns = {1: "once", 2: "twice"}.get(len(steps), f"{len(steps)} times")
        worst = max(step.error_deg for step in steps)
        done = f"The hand turned the object {turns}, each time to within {worst:.2f} deg of the target"
    if steps and summary.pushes:
        pushes = "a push" if len(summary.pushes) == 1 else f"{len(summary.pushes)} pushes"
        furthest = max(push.remaining_mm for push in summary.pushes)
        done += f", and held it against {pushes}: back within {furthest:.1f} mm"
    return RunVerdict(
        not faults, f"Not as it should be: {'; '.join(faults)}." if faults else f"{done}.", tuple(grounds)
    )
