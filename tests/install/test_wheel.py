"""The wheel in fresh environments, from a foreign folder: every --help, the documents, the demo in lock step.

Interpreters are searched for in PATH and among those of pyenv; packages come from the index, or from uv's
cache when there is no network.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
VERSIONS = ("3.11", "3.12", "3.13")
EXTRAS = ("", "onnx", "host", "record", "view", "train", "twin", "demo")
UV = Path(sys.executable).with_name("uv")
# Walks all commands in one process: what a command imports for its help is missing in a bare environment.
ALL_HELPS = """
import click
from click.testing import CliRunner
from palpate_edge.cli.main import cli as edge
from palpate_host.cli.main import cli as host

def walk(command, words, parent):
    context = click.Context(command, info_name=words[-1], parent=parent)
    yield words
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            yield from walk(command.get_command(context, name), (*words, name), context)

count = 0
for name, cli in (("palpate-edge", edge), ("palpate-host", host)):
    for words in walk(cli, (name,), None):
        done = CliRunner().invoke(cli, [*words[1:], "--help"], prog_name=name)
        assert done.exit_code == 0 and "Usage: " in done.output, (words, done.output, done.exception)
        count += 1
print(count)
"""

pytestmark = pytest.mark.slow


def interpreter(version: str) -> str:
    """Return the path of this Python version; skip without one."""
    candidates = [shutil.which(f"python{version}")]
    candidates += sorted(map(str, (Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python")))
    for candidate in filter(None, candidates):
        done = subprocess.run([candidate, "--version"], capture_output=True, text=True, check=False)
        if done.returncode == 0 and f" {version}." in done.stdout:
            return candidate
    pytest.skip(f"no Python {version} on this machine")


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project's wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return next(folder.glob("*.whl"))


@pytest.fixture
def installed(wheel: Path, tmp_path: Path) -> Callable[[str, str], Path]:
    """``installed(version, extra)``: the folder of the commands of a fresh environment with the wheel."""

    def install(version: str, extra: str) -> Path:
        python = interpreter(version)
        if not UV.exists():
            pytest.skip("uv is not installed")
        environment = tmp_path / "environment"
        subprocess.run([UV, "venv", "--quiet", "--python", python, environment], check=True)
        what = f"palpate[{extra}] @ {wheel.as_uri()}" if extra else f"palpate @ {wheel.as_uri()}"
        command = [UV, "pip", "install", "--quiet", "--python", environment / "bin" / "python", what]
        for offline in ([], ["--offline"]):
            done = subprocess.run([*command, *offline], capture_output=True, text=True, check=False)
            if done.returncode == 0:
                return environment / "bin"
        pytest.skip(f"the packages of palpate[{extra}] for Python {version} cannot be had: {done.stderr}")

    return install


def run(commands: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return subprocess.run(
        [commands / words[0], *words[1:]],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("extra", EXTRAS)
@pytest.mark.parametrize("version", VERSIONS)
def test_every_help_is_printed(installed, tmp_path: Path, version: str, extra: str) -> None:
    commands = installed(version, extra)
    (tmp_path / "foreign").mkdir()
    done = run(commands, tmp_path / "foreign", "python", "-c", ALL_HELPS)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 60
    assert list((tmp_path / "foreign").iterdir()) == []


def test_the_wheel_has_the_kernels_of_all_machines_and_no_other_file_is_built(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    libraries = {name.rsplit("/", 1)[1] for name in names if name.endswith(".so")}
    assert libraries == {"aarch64.so", "x86_64.so", "x86_64_v3.so"}
    assert wheel.name.endswith("-py3-none-any.whl")


@pytest.mark.parametrize("version", VERSIONS)
def test_a_bare_install_loads_its_kernels(installed, tmp_path: Path, version: str) -> None:
    words = "from palpate_edge.vision.subpixel import refined_places as f; import numpy as n; "
    words += "print(f(n.full((40, 40), 9, n.uint8), n.full((1, 2), 7.0), 8.0))"
    done = run(installed(version, ""), tmp_path, "python", "-c", words)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("[[7")


@pytest.mark.parametrize("version", VERSIONS)
def test_a_bare_install_names_the_missing_extra_and_has_the_documents(installed, tmp_path, version) -> None:
    commands = installed(version, "")
    (tmp_path / "foreign").mkdir()
    for words, extra in {
        ("demo", "--lockstep"): "demo",
        ("run", "--config", "hand.toml"): "host",
        ("bus", "budget"): "host",
        ("view", "hand.log"): "view",
        ("record", "-o", "recording"): "record",
        ("simulate", "dome", "press"): "twin",
    }.items():
        done = run(commands, tmp_path / "foreign", "palpate-host", *words)
        assert done.returncode == 2, (words, done.stderr)
        assert done.stderr.endswith(f"pip install 'palpate[{extra}]'\n"), (words, done.stderr)
        assert done.stderr.count("\n") == 1
    page = run(commands, tmp_path / "foreign", "palpate-host", "docs", "building")
    assert page.stdout.startswith("# Building a sensor")
    example = run(commands, tmp_path / "foreign", "palpate-host", "example", "hand.toml", "-o", "hand.toml")
    assert example.returncode == 0, example.stderr
    assert (tmp_path / "foreign" / "hand.toml").read_bytes() == (
        ROOT / "host" / "palpate_host" / "models" / "table4.toml"
    ).read_bytes()


@pytest.mark.parametrize("version", VERSIONS)
def test_the_demo_runs_in_lock_step_in_a_foreign_folder(installed, tmp_path: Path, version: str) -> None:
    commands = installed(version, "demo")
    (tmp_path / "foreign").mkdir()
    packages = {path for path in commands.parent.rglob("*") if path.suffix != ".pyc"}
    done = run(
        commands, tmp_path / "foreign", "palpate-host", "demo", "--lockstep", "--duration", "3", "--no-view"
    )
    assert done.returncode == 0, done.stderr
    assert [path.name for path in (tmp_path / "foreign").iterdir()] == ["demo"]
    assert (tmp_path / "foreign" / "demo" / "report.html").stat().st_size > 100_000
    written = {path for path in commands.parent.rglob("*") if path.suffix != ".pyc"} - packages
    assert [path for path in written if path.name != "__pycache__"] == []
