"""A robot's install: every module is imported in a process that has neither the twin nor any extra's
packages.

A module may need an extra where its docstring, or its room's, states "Needs the extra NAME"; such a module
must really need it, so that the statement stays true.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PARTS = {"palpate_edge": "edge", "palpate_bus": "host", "palpate_host": "host"}

# Import names of what only the twin, a test or an extra other than `host` installs.
EXTRAS = {"felupe", "foxglove", "google", "mcap", "mcap_protobuf", "onnx", "onnxruntime", "pyarrow", "rerun"}
EXTRAS |= {"hypothesis", "linuxpy", "pinocchio", "pytest", "scipy", "sklearn", "skl2onnx", "palpate_twin"}
ROS = {
    "rclpy",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "palpate_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
}
HOST_EXTRA = {"matplotlib", "mujoco", "pymodbus", "serial", "rich"}
NEED_ROS = {"palpate_host.ros.actions", "palpate_host.ros.bridge", "palpate_host.ros.messages"}
BLOCKED = {
    # A fingertip's board has the base dependencies alone, and nothing of the host.
    "palpate_edge": EXTRAS | HOST_EXTRA | {"palpate_bus", "palpate_host"},
    "palpate_bus": EXTRAS | HOST_EXTRA - {"rich"} | {"palpate_host"},
    "palpate_host": EXTRAS | ROS,
}
IMPORT_ALL = """
import importlib, json, pkgutil, sys

package, blocked = sys.argv[1], set(sys.argv[2].split(","))

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocker())
failed, imported = {}, []
for module in pkgutil.walk_packages(importlib.import_module(package).__path__, package + "."):
    try:
        importlib.import_module(module.name)
        imported.append(module.name)
    except ModuleNotFoundError as error:
        failed[module.name] = error.name.partition(".")[0]
print(json.dumps([imported, failed]))
"""


def run(code: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True, timeout=120
    )
    return done.stdout


def extra_of(module: str) -> str:
    """Return the extra that the docstring of a module, or of a package around it, names; empty for none."""
    parts = module.split(".")
    for depth in range(len(parts), 0, -1):
        base = ROOT / PARTS[parts[0]] / Path(*parts[:depth])
        path = base.with_suffix(".py") if base.with_suffix(".py").exists() else base / "__init__.py"
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        found = re.search(r"\bNeeds\s+the\s+extra\s+`*(\w+)", text)
        if found:
            return found[1]
    return ""


@pytest.fixture(scope="module", params=PARTS)
def outcome(request) -> tuple[str, list[str], dict[str, str]]:
    """A package, its modules that can be imported, and those that cannot with the package they lack."""
    package = request.param
    imported, failed = json.loads(run(IMPORT_ALL, package, ",".join(BLOCKED[package])))
    assert len(imported) > 20
    needs_ros = {module for module, lacks in failed.items() if lacks in ROS}  # no extra installs ROS 2
    assert needs_ros <= NEED_ROS
    failed = {module: lacks for module, lacks in failed.items() if module not in needs_ros}
    return package, imported, failed


def test_every_module_is_imported_without_twin_and_extras(outcome):
    _, _, failed = outcome
    undocumented = {module: lacks for module, lacks in failed.items() if not extra_of(module)}
    assert not undocumented


def test_no_module_needs_the_twin_or_a_package_above_it(outcome):
    _, _, failed = outcome
    assert not {lacks for lacks in failed.values() if lacks.startswith("palpate")}


def test_stated_extras_exist_and_are_needed(outcome):
    _, imported, failed = outcome
    known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    stated = {module: extra for module in (*imported, *failed) if (extra := extra_of(module))}
    assert set(stated.values()) <= set(known)
    rooms = {".".join(module.split(".")[:2]) for module in stated}
    assert rooms == {".".join(module.split(".")[:2]) for module in failed}


@pytest.mark.parametrize(
    ("package", "command"), [("palpate_edge", "palpate-edge"), ("palpate_host", "palpate-host")]
)
def test_help_needs_no_twin_either(package, command):
    code = (
        IMPORT_ALL.split("failed, imported", maxsplit=1)[0]
        + f"from {package}.cli.main import cli\ncli(['--help'])"
    )
    assert "Usage: " in run(code, package, ",".join(BLOCKED[package]))
