"""Write the wheelhouse, from which boards install without network, and sign it.

wheelhouse/PYTHON/MANIFEST.json       name of the release (version, digest, PYTHON: cp311 or cp313), version,
                                      time, contract (digest of the fingertip's objects), SHA-256 of each file
wheelhouse/PYTHON/MANIFEST.json.sig   its ssh signature, without which no board installs anything
wheelhouse/PYTHON/PART/ARCHITECTURE/  wheels, packages.txt, palpate.txt; PART is edge or host
packages.txt lists the third-party packages, palpate.txt palpate itself: an update installs only what differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

PROJECT = Path(__file__).resolve().parents[1]
OBJECTS = "edge/palpate_edge/node/fingertip.parsed.json"  # the fingertip's EDS without comments
MANIFEST, NAMESPACE = "MANIFEST.json", "palpate-release"
ARCHITECTURES = ("aarch64", "x86_64")
PARTS = ("edge", "host")
PYTHONS = ("3.11", "3.13")  # Debian 12 and 13
OLDEST_GLIBC, BOARDS_GLIBC = 17, 36  # manylinux2014; Debian 12
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "--quiet")


def requirements(lock: str, python: str) -> str:
    """Return the entries of a lock for this Python; pip would evaluate them for the Python that runs it."""
    environment = {"python_version": python, "python_full_version": f"{python}.0"}
    kept = []
    for entry in lock.replace("\\\n", "").splitlines():
        if not entry.strip() or entry.startswith("#"):
            continue
        name, *hashes = entry.split(" --hash=")
        requirement = Requirement(name)
        if requirement.marker is None or requirement.marker.evaluate(environment):
            requirement.marker = None
            kept.append(" \\\n    ".join([str(requirement), *(f"--hash={one.strip()}" for one in hashes)]))
    return "\n".join(kept) + "\n"


def own_wheel(folder: Path) -> Path:
    """Build palpate's own wheel: the same bytes for the same sources."""
    subprocess.run(
        [*PIP, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder, PROJECT], check=True
    )
    return next(folder.glob("palpate-*.whl"))


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def fill(folder: Path, wheel: Path, part: str, architecture: str, python: str) -> None:
    """Write one part for one architecture."""
    folder.mkdir(parents=True)
    text = requirements((PROJECT / "requirements" / f"{part}.lock").read_text(), python)
    listed = folder / "packages.txt"
    listed.write_text(text)
    platforms = [f"manylinux_2_{glibc}_{architecture}" for glibc in range(OLDEST_GLIBC, BOARDS_GLIBC + 1)]
    command = [*PIP, "download", "--require-hashes", "--only-binary=:all:", "--dest", folder]
    command += ["--implementation", "cp", "--python-version", python, "--requirement", listed]
    command += [word for platform in platforms for word in ("--platform", platform)]
    subprocess.run([*command, "--no-deps"], check=True)
    shutil.copy(wheel, folder)
    version = wheel.name.split("-")[1]
    (folder / "palpate.txt").write_text(f"palpate=={version} --hash=sha256:{sha256(wheel)}\n")


def release_name(version: str, digest: str, python: str) -> str:
    """Return the name of a release: boards of two Pythons have different ones of the same sources."""
    return f"{version}-{digest[:8]}-{tag(python)}"


def write_manifest(folder: Path, release: str, version: str, made_at: int) -> None:
    """List every file below `folder`, with what an update compares. made_at: Unix time, s."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    manifest = {
        "release": release,
        "version": version,
        "made_at": made_at,
        "contract": sha256(PROJECT / OBJECTS),
        "files": {path.relative_to(folder).as_posix(): sha256(path) for path in files},
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")


def sign(manifest: Path, key: Path) -> None:
    """Write the manifest's signature beside it; a key with a password asks for it."""
    subprocess.run(["ssh-keygen", "-q", "-Y", "sign", "-f", key, "-n", NAMESPACE, manifest], check=True)


def tag(python: str) -> str:
    """Return a Python version as wheels name it: cp311 of 3.11."""
    return f"cp{python.replace('.', '')}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder to write; its content is replaced")
    parser.add_argument(
        "--python",
        action="append",
        help=f"a Python of the boards; may be repeated (default: {', '.join(PYTHONS)})",
    )
    parser.add_argument(
        "--part", choices=PARTS, action="append", help="write only this part; may be repeated"
    )
    parser.add_argument(
        "--architecture", choices=ARCHITECTURES, action="append", help="write only this one; may be repeated"
    )
    parser.add_argument("--key", type=Path, help="ssh key that signs the release (default: not signed)")
    wanted = parser.parse_args()
    parts = wanted.part or PARTS
    unfinished = wanted.folder.with_name(f"{wanted.folder.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir(parents=True)
    wheel = own_wheel(unfinished)
    locks = [(PROJECT / "requirements" / f"{part}.lock").read_bytes() for part in parts]
    digest = hashlib.sha256(b"".join([*locks, wheel.read_bytes()])).hexdigest()
    version = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["version"]
    for python in wanted.python or PYTHONS:
        folder = unfinished / tag(python)
        for part in parts:
            for architecture in wanted.architecture or ARCHITECTURES:
                print(f"wheelhouse: {part} for {architecture}, Python {python}", file=sys.stderr, flush=True)
                fill(folder / part / architecture, wheel, part, architecture, python)
        write_manifest(folder, release_name(version, digest, python), version, int(time.time()))
        if wanted.key:
            sign(folder / MANIFEST, wanted.key)
    wheel.unlink()
    shutil.rmtree(wanted.folder, ignore_errors=True)
    unfinished.rename(wanted.folder)


if __name__ == "__main__":
    main()
