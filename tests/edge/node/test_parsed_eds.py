"""What was parsed of an EDS lies beside it, says the same, and counts only for that very file."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from palpate_edge.node.eds import load_eds
from palpate_edge.node.parsed_eds import FINGERTIP_EDS, parsed_path

NODE = 0x10
VENDOR = (0x1018, 1)


def copied(folder: Path) -> Path:
    eds = folder / FINGERTIP_EDS.name
    shutil.copy(FINGERTIP_EDS, eds)
    shutil.copy(parsed_path(FINGERTIP_EDS), parsed_path(eds))
    return eds


def test_it_says_what_the_file_says(tmp_path: Path) -> None:
    """When it does not: python -m palpate_edge.node.eds_parser."""
    alone = shutil.copy(FINGERTIP_EDS, tmp_path / FINGERTIP_EDS.name)
    assert load_eds(FINGERTIP_EDS, NODE) == load_eds(alone, NODE)


def test_it_is_what_a_fingertip_reads() -> None:
    """Neither daemon nor node imports the parser, nor python-can to open a CAN socket."""
    program = (
        "import sys, palpate_edge.daemon.daemon; from palpate_edge.node.eds import load_eds; "
        "from palpate_edge.node.parsed_eds import FINGERTIP_EDS; load_eds(FINGERTIP_EDS, 1)\n"
        "from palpate_edge.can_bus.bus import BusConfig, BusError, open_bus\n"
        "try: open_bus(BusConfig(channel='can-not-there'), 'finger-1')\n"
        "except BusError: print({'canopen', 'can'} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_a_file_that_was_changed_is_parsed_anew(tmp_path: Path) -> None:
    eds = copied(tmp_path)
    assert load_eds(eds, NODE).entries[VENDOR].default == 0
    head, tail = eds.read_text().split("[1018sub1]", 1)
    eds.write_text(head + "[1018sub1]" + tail.replace("DefaultValue=0x00000000", "DefaultValue=0x4D2", 1))
    assert load_eds(eds, NODE).entries[VENDOR].default == 0x4D2


@pytest.mark.parametrize("left", ["", "{}", "[", '{"checksum": 1}'])
def test_a_damaged_one_is_passed_over(tmp_path: Path, left: str) -> None:
    eds = copied(tmp_path)
    parsed_path(eds).write_text(left)
    assert load_eds(eds, NODE) == load_eds(FINGERTIP_EDS, NODE)
