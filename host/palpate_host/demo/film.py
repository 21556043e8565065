"""The film of a run: drawn by MuJoCo where OpenGL works without a display, plainly where it does not."""

from __future__ import annotations

import os
import subprocess
import sys

from palpate_host.demo.processes import DemoError, Program
from palpate_host.demo.run_folder import RunFolder

OFFSCREEN = ("egl", "osmesa")  # MUJOCO_GL; each is tried in a process of its own, for it binds at import
TIMEOUT_S = 300.0


def film_arguments(folder: RunFolder) -> list[str]:
    """Of the command that draws it."""
    paths = ["--config", str(folder.hand_toml), "--motion", str(folder.motion)]
    return ["simulate", "film", *paths, "-o", str(folder.film)]


def make_film(folder: RunFolder) -> str:
    """Write folder.film and the stills beside it; returns how they were drawn. Raises DemoError."""
    wanted = os.environ.get("MUJOCO_GL")
    for backend in (wanted,) if wanted else OFFSCREEN:
        if _draw(folder, backend).returncode == 0:
            return f"drawn by MuJoCo with OpenGL ({backend})"
    done = _draw(folder, None)
    if done.returncode != 0:
        raise DemoError(f"the film could not be drawn: {done.stderr.strip()}")
    return "drawn plainly: this machine has no OpenGL without a display (EGL or OSMesa)"


def _draw(folder: RunFolder, backend: str | None) -> subprocess.CompletedProcess[str]:
    arguments = film_arguments(folder) + (["--plain"] if backend is None else [])
    return subprocess.run(
        [sys.executable, "-m", Program.HOST.value, *arguments],
        env=os.environ | ({} if backend is None else {"MUJOCO_GL": backend}),
        check=False,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
