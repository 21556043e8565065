#!/usr/bin/python3
"""Check a signed release, then unpack it: nothing before signature, version and every file are right.

The folder has MANIFEST.json and MANIFEST.json.sig: docs/deploying.md. One file, as palpate_release.py.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import re
import shutil
import subprocess
import tarfile
from pathlib import Path
from typing import Any

BASE = Path("/opt/palpate")
MANIFEST, SIGNATURE = "MANIFEST.json", "MANIFEST.json.sig"
NAMESPACE = SIGNER = "palpate-release"
LARGEST_MANIFEST = 1 << 20  # bytes


def signed_manifest(folder: Path, signers: Path) -> dict[str, Any]:
    """Return the manifest, whose signature was checked over the bytes that are parsed."""
    try:
        with (folder / MANIFEST).open("rb") as file:
            text = file.read(LARGEST_MANIFEST)
    except OSError as error:
        raise SystemExit(f"error: no release in {folder}: {error.strerror}: {MANIFEST}") from None
    if not (folder / SIGNATURE).exists():
        raise SystemExit(
            f"error: the release is not signed: no {SIGNATURE}: make wheelhouse RELEASE_KEY=FILE"
        )
    command = ["ssh-keygen", "-Y", "verify", "-f", signers, "-I", SIGNER, "-n", NAMESPACE]
    answer = subprocess.run(
        [*command, "-s", folder / SIGNATURE], input=text, capture_output=True, check=False
    )
    if answer.returncode != 0:
        said = (answer.stderr or answer.stdout).decode(errors="replace").strip().replace("\n", "; ")
        raise SystemExit(f"error: the signature of {MANIFEST} is not of a key in {signers}: {said}")
    return dict(json.loads(text))


def order(manifest: dict[str, Any]) -> tuple[list[int], int]:
    """Return what grows from release to release: the version's numbers, and the time of making."""
    return [int(number) for number in re.findall(r"\d+", manifest["version"])], manifest["made_at"]


def refuse_older(manifest: dict[str, Any], active: Path) -> None:
    """Refuse a release that is older than the active one, whose manifest is `active`."""
    if not active.exists():  # the first release, or one from before manifests
        return
    present = json.loads(active.read_text())
    if manifest["release"] == present["release"] or order(manifest) >= order(present):
        return
    raise SystemExit(
        f"error: {manifest['release']} is older than the active {present['release']}: "
        "rollback.yml returns to the previous release, -e release_downgrade=true installs this one"
    )


def checked_files(archive: tarfile.TarFile, wanted: dict[str, str], part: str) -> list[tarfile.TarInfo]:
    """Return the members of the archive. Each one is a file that the manifest lists for the part."""
    members = archive.getmembers()
    for member in members:
        digest = wanted.get(f"{part}/{member.name}")
        file = archive.extractfile(member) if member.isreg() else None
        if digest is None or file is None or "/" in member.name:
            name = Path(str(archive.name)).name
            raise SystemExit(f"error: {name} has {member.name!r}, which {MANIFEST} does not list in {part}")
        if hashlib.file_digest(file, "sha256").hexdigest() != digest:
            raise SystemExit(f"error: {member.name} differs from {MANIFEST}: run make wheelhouse again")
    return members


def unpack(path: Path, part: str, manifest: dict[str, Any]) -> str:
    """Unpack an archive beside itself, if all of it is right, and remove it."""
    try:
        with tarfile.open(path, "r:") as archive:
            members = checked_files(archive, manifest["files"], part)
            for member in members:
                with path.with_name(member.name).open("wb") as file:
                    shutil.copyfileobj(archive.extractfile(member) or io.BytesIO(), file)
    except (tarfile.TarError, OSError) as error:
        raise SystemExit(f"error: {path}: {error}") from None
    path.unlink()
    return f"{manifest['release']}: {len(members)} files"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("verb", choices=["check", "unpack"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("part", help="part and architecture of this board, for example edge/aarch64")
    parser.add_argument("--archive", type=Path, help="wheels to unpack (default: wheels.tar in the folder)")
    parser.add_argument("--downgrade", action="store_true", help="allow a release older than the active one")
    parser.add_argument("--signers", type=Path, default=BASE / "release-signers", help="keys that may sign")
    parser.add_argument("--active", type=Path, default=BASE / "current" / MANIFEST, help="active manifest")
    wanted = parser.parse_args()
    manifest = signed_manifest(wanted.folder, wanted.signers)
    if not any(name.startswith(f"{wanted.part}/") for name in manifest["files"]):
        raise SystemExit(f"error: {manifest['release']} has nothing for {wanted.part}: run make wheelhouse")
    if not wanted.downgrade:
        refuse_older(manifest, wanted.active)
    if wanted.verb == "unpack":
        print(unpack(wanted.archive or wanted.folder / "wheels.tar", wanted.part, manifest))
    else:
        print(f"signed: {manifest['release']}")


if __name__ == "__main__":
    main()
