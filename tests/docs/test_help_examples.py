"""`--help` of every command: a summary in the imperative, and examples whose options exist and that run."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from palpate_edge.cli.main import cli as edge_cli
from palpate_host.cli.main import cli as host_cli

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS: dict[str, click.Command] = {"palpate-edge": edge_cli, "palpate-host": host_cli}
MODULES = {"palpate-edge": "palpate_edge.cli.main", "palpate-host": "palpate_host.cli.main"}
NOT_IMPERATIVE = re.compile(r"(The|An?|All|What|How|Where|Whether|It|Its|This|That|\w+[^s]s)\b")
TO_RUN = (
    "palpate-edge calibrate demo/recording/press -o finger-1.cal",
    "palpate-edge estimate demo/recording/press --calibration finger-1.cal --csv contacts.csv",
    "palpate-edge evaluate demo/recording/press --calibration finger-1.cal --split train",
    "palpate-edge follow demo/recording/finger-1/frames.webm -o tracks.png",
    "palpate-edge inspect demo/recording/press/reference/000.jpg -o beads.png",
    "palpate-host experiment --list",
    "palpate-host simulate sensor demo/recording/press/sensor.toml",
    "palpate-host simulate hand --hand table3",
    "palpate-host bus budget --joints 5 --fps 120",
    "palpate-host bus check-eds firmware/fingertip.eds",
)
"""Examples that need neither hardware nor a running program, in an order in which each has its files."""


def leaves(command: click.Command, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    if not isinstance(command, click.Group):
        yield path, command
        return
    context = click.Context(command, info_name=path[-1])
    for name in command.list_commands(context):
        below = command.get_command(context, name)
        assert below is not None
        yield from leaves(below, (*path, name))


COMMANDS = [leaf for program, cli in PROGRAMS.items() for leaf in leaves(cli, (program,))]


def examples(command: click.Command) -> list[str]:
    """Return the example lines of a help text, joined where they go on, without comments, pipes and `&`."""
    lines = re.sub(r"\\\n\s*", "", command.help or "").splitlines()
    found = []
    for line in lines:
        text = re.sub(r"^\s*(\w+=\S+\s+)*", "", line)
        if text.startswith(tuple(PROGRAMS)):
            found.append(re.split(r"\s+#|\s+\||\s+&$", text)[0])
            found += re.findall(r"\$\((.*?)\)", text)
    return found


@pytest.mark.parametrize(("path", "command"), COMMANDS, ids=[" ".join(path) for path, _ in COMMANDS])
def test_a_command_has_a_summary_and_an_example(path: tuple[str, ...], command: click.Command) -> None:
    summary = (command.help or "").strip().splitlines()[0]
    assert not NOT_IMPERATIVE.match(summary), summary
    assert any(line.startswith(" ".join(path)) for line in examples(command)), (
        "no example of the command itself"
    )


ALL_EXAMPLES = sorted({line for _, command in COMMANDS for line in examples(command)})


@pytest.mark.parametrize("line", ALL_EXAMPLES)
def test_the_options_of_an_example_exist(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """click parses the whole line; a file or folder that the example names is made when it is missed."""
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(re.sub(r"\$\(.*?\)", "", line))
    for word in words:
        if re.fullmatch(r"[\w-][\w./-]*\.\w{2,5}", word):
            Path(word).parent.mkdir(parents=True, exist_ok=True)
            Path(word).touch()
    for _ in words:  # each missing folder is named once
        try:
            parse(PROGRAMS[program], program, words)
            break
        except click.BadParameter as missing:
            name = re.search(r"'([^']+)' does not exist", missing.message)
            assert name is not None, missing.message
            Path(name[1]).mkdir(parents=True)
    else:
        parse(PROGRAMS[program], program, words)


def parse(command: click.Command, name: str, words: list[str], parent: click.Context | None = None) -> None:
    context = command.make_context(name, list(words), parent=parent)
    if isinstance(command, click.Group):
        below_name, below, rest = command.resolve_command(context, [*context._protected_args, *context.args])
        assert below is not None
        parse(below, below_name or "", rest, context)


def test_an_option_that_does_not_exist_is_found() -> None:
    with pytest.raises(click.UsageError):
        parse(edge_cli, "palpate-edge", ["follow", "video.avi", "--no-such-option"])


@pytest.mark.long
@pytest.mark.process
def test_examples_run(tmp_path: Path) -> None:
    """In a folder that sees `demo` and `firmware` of the checkout, as a person's shell would."""
    for name in ("demo", "firmware"):
        (tmp_path / name).symlink_to(ROOT / name)
    assert set(TO_RUN) <= set(ALL_EXAMPLES)
    for line in TO_RUN:
        program, *words = shlex.split(line)
        command = [sys.executable, "-m", MODULES[program], *words]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}: {done.stderr}"


@pytest.mark.process
@pytest.mark.parametrize(
    ("line", "status"),
    [
        ("palpate-edge run --config none.toml", 2),
        ("palpate-edge calibrate none -o out.cal", 3),
        ("palpate-edge estimate none --calibration none.cal --csv out.csv", 4),
        ("palpate-host run --config none.toml", 2),
        ("palpate-host command --socket none.sock status", 9),
    ],
)
def test_exit_statuses_are_those_of_the_help(tmp_path: Path, line: str, status: int) -> None:
    program, *words = shlex.split(line)
    command = [sys.executable, "-m", MODULES[program], *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
