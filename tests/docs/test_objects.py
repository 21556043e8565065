"""docs/objects.md is what `python -m bench.objects` writes, and has every object of the EDS."""

from __future__ import annotations

import re

from bench.objects import PAGE, page

from palpate_edge.node.eds import load_eds
from palpate_edge.node.parsed_eds import FINGERTIP_EDS

TEXT = PAGE.read_text(encoding="utf-8")


def test_the_page_is_what_the_command_writes():
    assert page() == TEXT, "run python -m bench.objects"


def test_every_object_has_its_row_with_name_access_and_default():
    od = load_eds(FINGERTIP_EDS, 1)
    rows = {}
    for line in TEXT.splitlines():
        if match := re.match(r"\| ([0-9A-F]{4})h:([0-9A-F]{2}) \| (.*) \|$", line):
            rows[int(match[1], 16), int(match[2], 16)] = match[3].split(" | ")
    assert rows.keys() == od.entries.keys()
    for key, entry in od.entries.items():
        name, kind, access, _, default, mappable, *_ = (cell.strip() for cell in rows[key])
        assert name.endswith(entry.name)
        assert (kind, access) == (entry.data_type.name, entry.access.value)
        assert (mappable == "yes") == entry.pdo_mappable
        number = int(default[:-1], 16) if default.endswith("h") else default
        if default or entry.access.readable:  # 6125h has none: it is only written
            assert str(number) == str(entry.default), (key, default)


def test_the_states_of_the_bus_clock_and_each_counter_are_explained():
    assert re.search(r"^\| 2042h:01 .*0 free: .* 1 synchronised\. 2 lost: ", TEXT, re.MULTILINE)
    for sub in range(1, 19):
        note = re.search(rf"^\| 2041h:{sub:02X} .*\| ([^|]*) \|$", TEXT, re.MULTILINE)
        assert note is not None and note[1].endswith("."), f"2041h:{sub:02X}"
    assert re.search(r"^\| 8110h \| receive overrun", TEXT, re.MULTILINE)
