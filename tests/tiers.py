"""The pytest plugin that puts every test into its tier (docs/testing.md).

A test's tier follows from its markers. `process` is set here, for every test whose own code or fixtures use
`subprocess`; `long`, `fem` and `slow` stand at the test, or in the lists below for a whole file. A test that
has none of them and needs no kernel and no board is a `check` test; it fails when it starts a process.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import pytest

TESTS = Path(__file__).parent
STARTS_A_PROCESS = {"subprocess", "multiprocessing"}
"""Modules: whoever uses one of them starts processes."""

PROCESS_FILES = (
    "host/operator/test_fd_session.py",
    "host/operator/test_session.py",
    "systemd/test_units.py",
    "twin/demo/test_demo_film.py",
    "twin/demo/test_demo_processes.py",
)
"""Files whose tests start processes through the code under test."""

PROCESS_FIXTURES = {"any_bus"}
"""Fixtures that start a process by way of another one, which they ask for by name."""

FEM_FILES = ("twin/dome/test_dome_solver.py", "twin/dome/test_dome_cli.py", "twin/dome/test_slip_onset.py")
"""Files whose tests solve finite elements."""

LONG_FILES = (
    "bad_input/test_files.py",
    "bad_input/test_outputs.py",
    "docs/test_readme_example.py",
    "edge/calibration/test_calibrate.py",
    "edge/calibration/training/test_calibrate_with_dome.py",
    "edge/calibration/training/test_pretrain.py",
    "edge/calibration/training/test_roll.py",
    "edge/diagnostics/test_video_tracking.py",
    "edge/estimation/test_correction_model.py",
    "edge/estimation/test_recorded_sensors.py",
    "edge/estimation/test_spliced_frames.py",
    "edge/geometry/test_marker_layout.py",
    "edge/guide/test_guide.py",
    "edge/node/test_fuzz_million.py",
    "firmware/test_identify.py",
    "firmware/test_light.py",
    "firmware/test_wire.py",
    "host/control/test_damping_stability.py",
    "host/control/test_rates_and_fingers.py",
    "host/drives/az/test_az_port.py",
    "host/drives/az/test_gateway.py",
    "host/drives/test_axes_hand.py",
    "host/drives/test_axes_homing.py",
    "host/drives/test_drive_modes.py",
    "host/experiment/test_experiment.py",
    "host/groundtruth/test_groundtruth.py",
    "host/recording/test_export.py",
    "host/recording/test_lerobot.py",
    "host/recording/test_live_server.py",
    "host/service/test_closed_loop.py",
    "host/service/test_commands.py",
    "host/setup/test_hand_setup.py",
    "host/view/test_view.py",
    "twin/camera/test_camera_dataset.py",
    "twin/closed_loop/test_live_hand.py",
    "twin/dome/test_dome_samples.py",
    "twin/paper/test_hand_loop.py",
    "twin/paper/test_hand_paper.py",
    "twin/paper/test_hold_states.py",
    "twin/paper/test_shake.py",
    "twin/paper/test_shake_random.py",
)
"""Files that take seconds each."""

SLOW_IN_USER_MODE_LINUX = (
    "bus/hub/test_any_bus.py::test_canopen_master_and_slave_of_the_canopen_package",
    "bus/hub/test_any_bus.py::test_several_processes_talk",
    "edge/node/test_canopen_lss_master.py",
    "kernel/test_canfd.py::test_the_daemon_sends_a_contact_as_one_frame_and_the_host_decodes_it",
    "kernel/test_fingertip_on_socketcan.py",
    "kernel/test_host_on_socketcan.py",
)
"""Files and tests that take long in user-mode Linux, where a process of ours starts slowly."""

LONG_FIXTURES = {"sample_calibration"}
"""Fixtures that take seconds."""

FIRST = (
    "deploy/test_namespace_board.py",
    "edge/node/test_fuzz_million.py",
    "edge/estimation/test_endurance.py",
    "twin/demo/test_demo.py",
    "host/service/test_closed_loop.py",
    "kernel/test_host_on_socketcan.py",
    "kernel/test_fingertip_on_socketcan.py",
    "bus/master/test_node_commands.py",
    "host/operator/test_session.py",
    "twin/paper/test_hand_paper.py",
    "edge/daemon/test_daemon.py",
    "edge/calibration/training/test_calibrate_with_dome.py",
    "edge/calibration/training/test_coverage_on_twins.py",
    "edge/estimation/test_drift.py",
    "bench/test_soak.py",
    "kernel/test_forwarding.py",
)
"""The longest files begin first: one that begins last keeps one of two workers waiting."""

ONLY_WITH_MARKER = (
    *("ros", "dcfgen", "kicad", "lerobot", "canopennode", "quiet"),
    *("deploy_namespace", "deploy_hand", "deploy_killed", "deploy_foreign", "deploy_booted", "deploy_cuts"),
)
"""Markers of tests that take minutes, need an environment of their own or an idle computer: only with -m."""

NOT_IN_CHECK = {
    *("process", "fem", "long", "slow", "reduced", "demo", "uml", "vm", "deploy_lint"),
    *ONLY_WITH_MARKER,
}

MARKERS = (
    "process: starts a process, or speaks to one (set by tests/tiers.py)",
    "long: takes more than half a second on a quiet core",
    "slow: takes minutes, or repeats with other seeds what a faster test shows (make slow-test)",
    "reduced: is shorter in make test than in make slow-test (set by tests/tiers.py)",
    "check: needs no process, no finite elements, no kernel; short (make check; set by tests/tiers.py)",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--effort",
        choices=("reduced", "full"),
        default="reduced",
        help="full: also the tests marked slow, and those marked reduced at full length (default: reduced)",
    )


def pytest_configure(config: pytest.Config) -> None:
    for marker in MARKERS:
        config.addinivalue_line("markers", marker)


@pytest.fixture(scope="session")
def effort(request: pytest.FixtureRequest) -> Callable[[int, int], int]:
    """``effort(reduced, full)``: how many frames, rounds or sensors a long test takes in this run."""
    is_full = request.config.getoption("--effort") == "full"
    return lambda reduced, full: full if is_full else reduced


def seeds(reduced: int, full: int) -> list[Any]:
    """Return the parameters 0 to full - 1 of a test; those from `reduced` on are marked slow."""
    marks = {False: (), True: (pytest.mark.slow,)}
    return [pytest.param(seed, marks=marks[seed >= reduced]) for seed in range(full)]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    marks = {}
    for item in items:
        for marker in _markers(item):
            item.add_marker(marker)
        marks[item] = {mark.name for mark in item.iter_markers()}
        if not marks[item] & NOT_IN_CHECK:
            item.add_marker("check")
    left_out = {name for name in ONLY_WITH_MARKER if name not in config.option.markexpr}
    is_named = any("::" in argument for argument in config.args)
    if config.getoption("--effort") != "full" and not is_named:
        left_out.add("slow")
    config.hook.pytest_deselected(items=[item for item in items if marks[item] & left_out])
    items[:] = [item for item in items if not marks[item] & left_out]
    order = {name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: order.get(_file(item), len(order)))


def _file(item: pytest.Item) -> str:
    return item.path.relative_to(TESTS).as_posix() if item.path.is_relative_to(TESTS) else ""


def _markers(item: pytest.Item) -> Iterator[str]:
    file, fixtures = _file(item), getattr(item, "fixturenames", [])
    if file in PROCESS_FILES or PROCESS_FIXTURES & set(fixtures) or _uses_processes(item):
        yield "process"
    if file in FEM_FILES:
        yield "fem"
    names = {file, f"{file}::{getattr(item, 'originalname', item.name)}"}
    if names & set(SLOW_IN_USER_MODE_LINUX) and item.get_closest_marker("uml"):
        yield "slow"
    if file in LONG_FILES or LONG_FIXTURES & set(fixtures):
        yield "long"
    if "effort" in fixtures:
        yield "reduced"


def _uses_processes(item: pytest.Item) -> bool:
    """Return whether the code of a test or of one of its fixtures uses one of STARTS_A_PROCESS."""
    if not isinstance(item, pytest.Function):
        return False
    fixtures = item._fixtureinfo.name2fixturedefs.values()
    functions = [item.obj, *(definitions[-1].func for definitions in fixtures)]
    return any(_reaches_processes(getattr(function, "__func__", function)) for function in functions)


@cache
def _reaches_processes(first: object) -> bool:
    """Return whether a function or class of the tests uses processes, itself or by what it names."""
    seen, waiting = set(), [first]
    while waiting:
        thing = waiting.pop()
        if id(thing) in seen:
            continue
        seen.add(id(thing))
        if isinstance(thing, ModuleType) and thing.__name__ in STARTS_A_PROCESS:
            return True
        waiting += _named_by(thing)
    return False


def _named_by(thing: object) -> Iterator[object]:
    """Yield what the code of a function or class of the tests names."""
    thing = getattr(thing, "__func__", getattr(thing, "__wrapped__", thing))
    if isinstance(thing, type) and _is_of_the_tests(sys.modules.get(thing.__module__)):
        yield from (value for value in vars(thing).values() if callable(value) or isinstance(value, property))
        yield from thing.__bases__
    if isinstance(thing, property):
        yield thing.fget
    if not isinstance(thing, FunctionType) or not _is_in_tests(thing.__code__.co_filename):
        return
    names = set(_names(thing.__code__))
    for name in names & thing.__globals__.keys():
        value = thing.__globals__[name]
        yield value
        if isinstance(value, ModuleType) and _is_of_the_tests(value):
            yield from (vars(value)[attribute] for attribute in names & vars(value).keys())


def _is_of_the_tests(module: ModuleType | None) -> bool:
    return _is_in_tests(getattr(module, "__file__", None) or "/")


@cache
def _is_in_tests(file: str) -> bool:
    return Path(file).is_relative_to(TESTS)


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


class Started:
    """Processes that this one has started, as the interpreter's audit events tell."""

    EVENTS = ("subprocess.Popen", "os.fork", "os.forkpty", "os.posix_spawn", "os.system")

    def __init__(self) -> None:
        self.commands: list[str] = []

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event in self.EVENTS:
            self.commands.append(f"{event} {arguments[0] if arguments else ''}".strip())


_STARTED = Started()
sys.addaudithook(_STARTED)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None]:
    _STARTED.commands.clear()
    yield
    _fail_where_a_process_was_started(item)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None]:
    yield
    _fail_where_a_process_was_started(item)


def _fail_where_a_process_was_started(item: pytest.Item) -> None:
    if _STARTED.commands and item.get_closest_marker("check"):
        text = f"starts a process ({_STARTED.commands[0]}) and is not marked `process`: see tests/tiers.py"
        pytest.fail(text, pytrace=False)
