"""Checks of a board before it unpacks a release. ssh-keygen makes the keys and signatures."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path
from types import ModuleType

import pytest

from deploy_rig.image import ANSIBLE

UNPACK = ANSIBLE / "roles/release/files/palpate_unpack.py"
PART = "edge/aarch64"
RELEASE, VERSION, MADE_AT = "1.10.0-12345678-cp311", "1.10.0", 1_700_000_000
FILES = {
    "palpate-1.10.0-py3-none-any.whl": b"the wheel",
    "packages.txt": b"numpy==2.3.4",
    "palpate.txt": b"palpate",
}

pytestmark = pytest.mark.skipif(
    shutil.which("ssh-keygen") is None, reason="openssh-client is missing: make system-deps"
)


def wheelhouse_program() -> ModuleType:
    spec = importlib.util.spec_from_file_location("wheelhouse", ANSIBLE / "wheelhouse.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Board:
    """A release in a wheelhouse, its key, and the folder on the board that it is copied to."""

    def __init__(self, folder: Path) -> None:
        self.house, self.wanted, self.incoming = folder / "house", folder / "wanted", folder / "incoming"
        self.active = folder / "active.json"
        self.key, self.signers = folder / "key", folder / "signers"
        self.program = wheelhouse_program()
        self.make_key(self.key)
        self.signers.write_text(f'palpate-release namespaces="palpate-release" {self.public(self.key)}')
        for part in (PART, "host/aarch64"):
            (self.house / part).mkdir(parents=True)
            for name, content in FILES.items():
                (self.house / part / name).write_bytes(content)
        (self.house / "host/aarch64/rich.whl").write_bytes(b"of the host alone")
        self.write_and_sign()

    @staticmethod
    def make_key(path: Path) -> None:
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", path], check=True)

    @staticmethod
    def public(key: Path) -> str:
        return key.with_suffix(".pub").read_text()

    def write_and_sign(self, version: str = VERSION, made_at: int = MADE_AT, name: str = RELEASE) -> None:
        for path in self.house.glob("MANIFEST.json*"):
            path.unlink()
        self.program.write_manifest(self.house, name, version, made_at)
        self.program.sign(self.house / "MANIFEST.json", self.key)

    def copy(self) -> None:
        """Copy to the board what the playbook copies."""
        for place in (self.wanted, self.incoming):
            shutil.rmtree(place, ignore_errors=True)
            place.mkdir()
        for path in self.house.glob("MANIFEST.json*"):
            shutil.copy(path, self.wanted)
        with tarfile.open(self.incoming / "wheels.tar", "w") as archive:
            for path in sorted((self.house / PART).iterdir()):
                archive.add(path, path.name)

    def run(self, *words: str, verb: str = "unpack") -> tuple[int, str]:
        command = [sys.executable, UNPACK, verb, self.wanted, PART, "--signers", self.signers]
        command += ["--archive", self.incoming / "wheels.tar"]
        answer = subprocess.run(
            [*command, "--active", self.active, *words], capture_output=True, text=True, check=False
        )
        return answer.returncode, answer.stdout + answer.stderr

    @property
    def unpacked(self) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in self.incoming.iterdir() if path.name != "wheels.tar"}

    def refuses(self, words: str, *options: str) -> None:
        status, output = self.run(*options)
        assert status == 1, output
        assert output.startswith("error: "), output
        assert words in output
        assert self.unpacked == {}


@pytest.fixture
def board(tmp_path: Path) -> Board:
    board = Board(tmp_path)
    board.copy()
    return board


def test_a_signed_release_is_unpacked(board: Board) -> None:
    assert board.run(verb="check") == (0, f"signed: {RELEASE}\n")
    assert board.unpacked == {}
    assert board.run() == (0, f"{RELEASE}: 3 files\n")
    assert board.unpacked == FILES


@pytest.mark.parametrize("file", ["MANIFEST.json", "MANIFEST.json.sig"])
@pytest.mark.parametrize("place", [0.1, 0.5, 0.9])
def test_one_byte_of_manifest_or_signature_is_refused(board: Board, file: str, place: float) -> None:
    content = bytearray((board.wanted / file).read_bytes())
    content[int(len(content) * place)] ^= 1
    (board.wanted / file).write_bytes(content)
    board.refuses("the signature of MANIFEST.json is not of a key in")


@pytest.mark.parametrize("file", FILES)
def test_one_byte_of_a_file_is_refused(board: Board, file: str) -> None:
    path = board.house / PART / file
    path.write_bytes(bytes([path.read_bytes()[0] ^ 1]) + path.read_bytes()[1:])
    board.copy()
    board.refuses(f"{file} differs from MANIFEST.json")


def test_an_unsigned_release_is_refused(board: Board) -> None:
    (board.wanted / "MANIFEST.json.sig").unlink()
    board.refuses("the release is not signed")


def test_the_signature_of_another_key_is_refused(board: Board, tmp_path: Path) -> None:
    board.make_key(tmp_path / "other")
    board.key = tmp_path / "other"
    board.write_and_sign()
    board.copy()
    board.refuses("is not of a key in")


def test_a_signature_for_another_purpose_is_refused(board: Board) -> None:
    """The key signs commits or mails as well: their namespace is another one."""
    manifest = board.wanted / "MANIFEST.json"
    manifest.with_suffix(".json.sig").unlink()
    subprocess.run(["ssh-keygen", "-q", "-Y", "sign", "-f", board.key, "-n", "file", manifest], check=True)
    board.refuses("is not of a key in")


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("extra.whl", tarfile.REGTYPE),
        ("../outside", tarfile.REGTYPE),
        ("/outside", tarfile.REGTYPE),
        ("rich.whl", tarfile.REGTYPE),
        ("palpate.txt", tarfile.SYMTYPE),
        ("folder", tarfile.DIRTYPE),
    ],
)
def test_a_member_that_the_manifest_does_not_list_for_this_part_is_refused(
    board: Board, name: str, kind: bytes
) -> None:
    with tarfile.open(board.incoming / "wheels.tar", "a") as archive:
        member = tarfile.TarInfo(name)
        member.type, member.linkname = kind, "/etc/passwd"
        archive.addfile(member)
    board.refuses(f"wheels.tar has {name!r}, which MANIFEST.json does not list in {PART}")
    assert not (board.incoming.parent / "outside").exists()


def test_a_cut_archive_is_refused(board: Board) -> None:
    archive = board.incoming / "wheels.tar"
    archive.write_bytes(archive.read_bytes()[:700])
    board.refuses("wheels.tar")


@pytest.mark.parametrize(
    ("version", "made_at", "is_older"),
    [
        ("1.9.0", MADE_AT + 1, True),
        (VERSION, MADE_AT - 1, True),
        (VERSION, MADE_AT, False),
        ("1.10.1", MADE_AT - 1, False),
        ("2.0", MADE_AT, False),
    ],
)
def test_an_older_release_needs_the_flag(board: Board, version: str, made_at: int, is_older: bool) -> None:
    """1.10 is newer than 1.9; of one version the later one is newer."""
    shutil.copy(board.wanted / "MANIFEST.json", board.active)
    board.write_and_sign(version, made_at, "another")
    board.copy()
    if is_older:
        board.refuses(f"another is older than the active {RELEASE}")
    assert board.run(*(["--downgrade"] if is_older else []))[0] == 0
    assert board.unpacked == FILES


def test_a_release_for_other_boards_is_refused(board: Board) -> None:
    shutil.rmtree(board.house / PART)
    (board.house / PART).mkdir()
    board.write_and_sign()
    board.copy()
    board.refuses(f"has nothing for {PART}")


def test_the_manifest_has_the_contract_of_the_fingertip(board: Board) -> None:
    """The digest of the parsed EDS, which the fingertip loads."""
    manifest = json.loads((board.house / "MANIFEST.json").read_text())
    parsed = ANSIBLE.parent / "edge/palpate_edge/node/fingertip.parsed.json"
    said = subprocess.run(["sha256sum", parsed], capture_output=True, text=True, check=True).stdout
    assert manifest["contract"] == said.split()[0]
