"""Report of the mutants, as a table and as JSON."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.operators import Mutant

KILLED = ("killed", "timeout")
OUTCOMES = (*KILLED, "survived", "uncovered")


@dataclass(frozen=True)
class Result:
    """Result of a mutant. tests: how many ran; covering: how many could have; by: the first to fail."""

    area: str
    mutant: Mutant
    outcome: str
    tests: int
    covering: int
    by: str
    seconds: float


def counts(results: list[Result]) -> dict[str, dict[str, int]]:
    """Return how many mutants had which outcome, by area and in total."""
    table: dict[str, dict[str, int]] = {}
    for area in [*dict.fromkeys(result.area for result in results), "total"]:
        outcomes = Counter(result.outcome for result in results if area in (result.area, "total"))
        table[area] = {outcome: outcomes[outcome] for outcome in OUTCOMES}
    return table


def markdown(results: list[Result]) -> str:
    """Return the table of the areas and the list of the mutants that no test noticed."""
    lines = [
        "| area | mutants | killed | of these by timeout | survived | uncovered | score | score of covered |"
    ]
    lines.append("|---|---:|---:|---:|---:|---:|---:|---:|")
    for area, outcomes in counts(results).items():
        number, killed = sum(outcomes.values()), sum(outcomes[outcome] for outcome in KILLED)
        covered = number - outcomes["uncovered"]
        scores = f"{killed / max(number, 1):.0%} | {killed / max(covered, 1):.0%}"
        others = f"{outcomes['timeout']} | {outcomes['survived']} | {outcomes['uncovered']}"
        lines.append(f"| {area} | {number} | {killed} | {others} | {scores} |")
    lines += [
        "",
        "Mutants that no test noticed, and how many of the tests that run their line were asked:",
        "",
    ]
    for result in results:
        mutant = result.mutant
        if result.outcome not in KILLED:
            asked = f"{result.outcome}, {result.tests} of {result.covering} tests"
            change = f"`{mutant.before}` -> `{mutant.after}`"
            lines.append(f"- {result.area} {mutant.path}:{mutant.line} ({asked}): {change}")
    return "\n".join(lines) + "\n"


def write_report(results: list[Result], seed: int, output: Path) -> None:
    """Write the results so far as .json and .md."""
    results = sorted(results, key=lambda result: (result.area, result.mutant.path, result.mutant.line))
    output.with_suffix(".json").write_text(as_json(results, seed))
    output.with_suffix(".md").write_text(markdown(results))


def as_json(results: list[Result], seed: int) -> str:
    """Return the counts and every mutant, without the text of its file."""
    hidden = {"text", "in_function", "statement_line"}
    rows = []
    for result in results:
        mutant = {name: value for name, value in vars(result.mutant).items() if name not in hidden}
        rows.append(vars(result) | {"mutant": mutant})
    return json.dumps({"seed": seed, "areas": counts(results), "mutants": rows}, indent=1) + "\n"
