"""Make the film of a demo run: by MuJoCo if OpenGL works without a display, else by the plain renderer."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from dataclasses import dataclass

from palpate_twin.demo.processes import Program
from palpate_twin.demo.run_folder import RunFolder

OFFSCREEN = ("egl", "osmesa")  # values of MUJOCO_GL; it is read at import, so each is tried in a new process
TIMEOUT_S = 300.0


@dataclass(frozen=True, slots=True)
class Film:
    """Result of making the film.

    is_there: the film and its stills were written. description: how they were drawn and what part of the run
    they show; if there are none, the reason and the command that makes them.
    """

    is_there: bool
    description: str


def film_arguments(folder: RunFolder) -> list[str]:
    """Return the arguments of palpate-host that draw the film."""
    paths = ["--config", str(folder.hand_toml), "--motion", str(folder.motion)]
    run = ["--run", str(folder.path)] if folder.has_pictures else []
    return ["simulate", "film", *paths, *run, "-o", str(folder.film)]


def film_command(folder: RunFolder) -> str:
    """Return the shell command that draws the film."""
    return shlex.join(["palpate-host", *film_arguments(folder)])


def make_film(folder: RunFolder, timeout_s: float = TIMEOUT_S) -> Film:
    """Write the film and its stills within `timeout_s`. A failure is returned, not raised."""
    _remove(folder)
    try:
        done, backend = _draw(folder, timeout_s)
    except subprocess.TimeoutExpired:
        return _failed(folder, f"was not drawn within {timeout_s:g} s")
    if done.returncode != 0:
        return _failed(folder, f"could not be drawn: {' '.join(done.stderr.split())}")
    renderer = f"({backend})" if backend else "(neither EGL nor OSMesa works on this machine)"
    description = f"{done.stdout.strip().removeprefix(f'{folder.film}: ')} {renderer}"
    return Film(is_there=True, description=description)


def _failed(folder: RunFolder, reason: str) -> Film:
    _remove(folder)  # partial files of a process that was killed
    description = f"the film {reason}; to draw it: {film_command(folder)}"
    return Film(is_there=False, description=description)


def _remove(folder: RunFolder) -> None:
    for path in (folder.film, folder.film.with_suffix(".png")):
        path.unlink(missing_ok=True)


Done = subprocess.CompletedProcess[str]


def _draw(folder: RunFolder, timeout_s: float) -> tuple[Done, str | None]:
    """Draw with the first backend that works, last the plain renderer, all within `timeout_s`.

    Returns the finished process and its MUJOCO_GL, which is None for the plain renderer.
    """
    configured = os.environ.get("MUJOCO_GL")
    end_s = time.monotonic() + timeout_s
    for backend in (configured,) if configured else OFFSCREEN:
        done = _draw_with(folder, backend, end_s)
        if done.returncode == 0:
            return done, backend
    return _draw_with(folder, None, end_s), None


def _draw_with(folder: RunFolder, backend: str | None, end_s: float) -> Done:
    arguments = film_arguments(folder) + (["--plain"] if backend is None else [])
    return subprocess.run(
        [sys.executable, "-m", Program.HOST.value, *arguments],
        env=os.environ | ({} if backend is None else {"MUJOCO_GL": backend}),
        check=False,
        capture_output=True,
        text=True,
        timeout=end_s - time.monotonic(),
    )
