"""A command whose extra is not installed: --help answers, the command itself names the extra in one line."""

from __future__ import annotations

import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from click.testing import CliRunner

from palpate_edge.common.errors import EXTRA_OF_LIBRARY, MissingExtraError
from palpate_host.common.lazy_group import LazyGroup

PROJECT = tomllib.loads((Path(__file__).resolve().parents[3] / "pyproject.toml").read_text())["project"]


@pytest.fixture
def group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> LazyGroup:
    """A group of commands, of which `draw` needs a library that is not installed."""
    (tmp_path / "needs_rerun.py").write_text("import rerun\n")
    (tmp_path / "needs_other.py").write_text("import no_such_library\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(sys.modules, "rerun", None)
    table = {
        "draw": ("needs_rerun:draw", "Draw something."),
        "show": ("needs_rerun:show", "Show something."),
        "broken": ("needs_other:broken", "Do nothing."),
    }
    return LazyGroup("tool", table=table, extras={"show": "demo"})


@pytest.mark.parametrize("words", [["draw", "--help"], ["draw", "a.log", "--speed", "3", "--help"]])
def test_help_is_printed_with_the_command_that_installs_it(group: LazyGroup, words: list[str]) -> None:
    done = CliRunner().invoke(group, words)
    assert done.exit_code == 0
    assert "Draw something." in done.output
    assert "pip install 'palpate[view]'" in " ".join(done.output.split())


def test_the_command_is_refused_in_one_line(group: LazyGroup) -> None:
    done = CliRunner().invoke(group, ["show", "a.log", "--speed", "3"])
    assert isinstance(done.exception, MissingExtraError)
    assert str(done.exception) == "tool show needs rerun: pip install 'palpate[demo]'"


def test_another_missing_module_stays_an_error_of_the_program(group: LazyGroup) -> None:
    done = CliRunner().invoke(group, ["broken"])
    assert isinstance(done.exception, ModuleNotFoundError)


def libraries_of(extra: str) -> set[str]:
    """Return the distributions of an extra, those of the extras in it included."""
    found = set()
    for requirement in PROJECT["optional-dependencies"][extra]:
        name = requirement.split(">")[0].split("=")[0]
        if name.startswith("palpate["):
            for inner in name.removeprefix("palpate[").rstrip("]").split(","):
                found |= libraries_of(inner)
        else:
            found.add(name)
    return found


@pytest.mark.parametrize(("library", "extra"), EXTRA_OF_LIBRARY.items())
def test_the_extra_of_a_library_installs_it(library: str, extra: str) -> None:
    installed_by = packages_distributions().get(library)
    if installed_by is None:
        pytest.skip(f"{library} is not installed")
    assert set(installed_by) & libraries_of(extra)
