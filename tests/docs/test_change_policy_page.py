"""The policy for changes against its table in docs/bus.md.

After a meant change: python tests/docs/test_change_policy_page.py writes the table of docs/bus.md.
"""

from __future__ import annotations

import re
from pathlib import Path

from palpate_edge.node.change_policy import RULES, Rule
from palpate_edge.node.nmt import NmtState

PAGE = Path(__file__).resolve().parents[2] / "docs" / "bus.md"
BLOCK = re.compile(
    r"(<!-- made by: python tests/docs/test_change_policy_page.py -->\n).*?(<!-- end -->\n)", re.S
)
HEAD = ("objects", "content", "written in", "at most")


def row_of(rule: Rule) -> tuple[str, ...]:
    first, last = rule.indices[0], rule.indices[-1]
    states = [state for state in (NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL) if state in rule.states]
    rate = rule.rate
    return (
        f"{first:04X}h" if first == last else f"{first:04X}h-{last:04X}h",
        rule.content,
        ", ".join(state.name.replace("_", "-") for state in states),
        "" if rate is None else f"{rate.burst}, then one in {rate.period_us // 1_000_000} s",
    )


def rendered() -> str:
    """Return the table as docs/bus.md has it."""
    rows = [HEAD, ("---",) * len(HEAD), *map(row_of, RULES)]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in rows)


def test_the_page_has_the_policy() -> None:
    page = PAGE.read_text()
    assert BLOCK.sub(lambda found: found[1] + rendered() + found[2], page) == page


if __name__ == "__main__":
    PAGE.write_text(BLOCK.sub(lambda found: found[1] + rendered() + found[2], PAGE.read_text()))
