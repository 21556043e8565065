"""The film of a run: drawn by MuJoCo where OpenGL works without a display, plainly where it does not."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from dataclasses import dataclass

from palpate_twin.demo.processes import Program
from palpate_twin.demo.run_folder import RunFolder

OFFSCREEN = ("egl", "osmesa")  # MUJOCO_GL; each is tried in a process of its own, for it binds at import
TIMEOUT_S = 300.0


@dataclass(frozen=True, slots=True)
class Film:
    """What became of it. is_there: folder.film and the stills beside it are written; told: how they were
    drawn and how much of the run they show, or why there are none and what makes them."""

    is_there: bool
    told: str


def film_arguments(folder: RunFolder) -> list[str]:
    """Of the command that draws it."""
    paths = ["--config", str(folder.hand_toml), "--motion", str(folder.motion)]
    return ["simulate", "film", *paths, "-o", str(folder.film)]


def film_command(folder: RunFolder) -> str:
    """The same for a person's shell."""
    return shlex.join(["palpate-host", *film_arguments(folder)])


def make_film(folder: RunFolder, timeout_s: float = TIMEOUT_S) -> Film:
    """Write folder.film and the stills beside it, within `timeout_s`; a run is worth its report without."""
    _remove(folder)
    try:
        done, backend = _draw(folder, timeout_s)
    except subprocess.TimeoutExpired:
        return _none(folder, f"was not drawn within {timeout_s:g} s")
    if done.returncode != 0:
        return _none(folder, f"could not be drawn: {' '.join(done.stderr.split())}")
    by = f"({backend})" if backend else "(no OpenGL without a display here: neither EGL nor OSMesa)"
    return Film(is_there=True, told=f"{done.stdout.strip().removeprefix(f'{folder.film}: ')} {by}")


def _none(folder: RunFolder, why: str) -> Film:
    _remove(folder)  # what a process that was ended has begun
    return Film(is_there=False, told=f"the film {why}; to draw it: {film_command(folder)}")


def _remove(folder: RunFolder) -> None:
    for path in (folder.film, folder.film.with_suffix(".png")):
        path.unlink(missing_ok=True)


Done = subprocess.CompletedProcess[str]


def _draw(folder: RunFolder, timeout_s: float) -> tuple[Done, str | None]:
    """By the first way that succeeds, else the last one's failure, and MUJOCO_GL. All have `timeout_s`."""
    wanted = os.environ.get("MUJOCO_GL")
    end_s = time.monotonic() + timeout_s
    for backend in (wanted,) if wanted else OFFSCREEN:
        done = _draw_by(folder, backend, end_s)
        if done.returncode == 0:
            return done, backend
    return _draw_by(folder, None, end_s), None


def _draw_by(folder: RunFolder, backend: str | None, end_s: float) -> Done:
    arguments = film_arguments(folder) + (["--plain"] if backend is None else [])
    return subprocess.run(
        [sys.executable, "-m", Program.HOST.value, *arguments],
        env=os.environ | ({} if backend is None else {"MUJOCO_GL": backend}),
        check=False,
        capture_output=True,
        text=True,
        timeout=end_s - time.monotonic(),
    )
