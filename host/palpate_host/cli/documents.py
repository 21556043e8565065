"""``palpate-host docs`` and ``palpate-host example``: the pages and examples that the package contains."""

from __future__ import annotations

from pathlib import Path

import click

import palpate_edge
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_host.config.packaged import MODELS

PACKAGE = Path(__file__).resolve().parents[1]
INSTALLED_DOCS, CHECKOUT_DOCS = PACKAGE / "docs", PACKAGE.parents[1] / "docs"
EXAMPLES = {
    "hand.toml": (MODELS / "table4.toml", "a hand of three fingers with CiA 402 drives; every key"),
    "az.toml": (MODELS / "table4-az.toml", "AZ drives on RS-485 for the hand of hand.toml"),
    "hand-wide.toml": (MODELS / "table4-wide.toml", "the hand of the demo"),
    "hand-table3.toml": (MODELS / "table3.toml", "the hand of the paper's Table 3"),
    "experiment.toml": (MODELS / "experiment.toml", "the protocol of palpate-host experiment"),
    "finger.toml": (PACKAGE / "examples" / "finger.toml", "a fingertip with a V4L2 camera on SocketCAN"),
    "sensor.toml": (
        Path(palpate_edge.__file__).parent / "setup" / "sensor.toml",
        "the geometry of a sensor with 85 beads",
    ),
}
"""Name -> the file, and its content in a few words."""


@click.command()
@click.argument("page", required=False)
@click.option("--path", "show_path", is_flag=True, help="Print the file's path instead of its text.")
def docs(page: str | None, show_path: bool) -> None:
    """List the pages of the documentation, or print one PAGE.

    \b
    Examples:
      palpate-host docs
      palpate-host docs building
      palpate-host docs building --path

    Exit status: 0 printed, 2 unknown page.
    """
    pages = {path.stem: path for path in docs_folder().glob("*.md")}
    if page is None:
        for name, path in sorted(pages.items()):
            click.echo(str(path) if show_path else f"{name:16}{_title(path)}")
        return
    chosen = pages.get(page.removesuffix(".md"))
    if chosen is None:
        raise ConfigError(f"{page} is not a page: list the pages with palpate-host docs")
    click.echo(str(chosen) if show_path else chosen.read_text(encoding="utf-8"), nl=show_path)


@click.command()
@click.argument("name", required=False)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Write the example to this new file; an existing file is kept.",
)
def example(name: str | None, output: Path | None) -> None:
    """List the example configurations, print one or write it to a file.

    \b
    Examples:
      palpate-host example
      palpate-host example finger.toml
      palpate-host example hand.toml -o my-hand.toml

    Exit status: 0 printed or written, 2 unknown example or existing file.
    """
    if name is None:
        for known, (_, content) in EXAMPLES.items():
            click.echo(f"{known:18}{content}")
        return
    if name not in EXAMPLES:
        raise ConfigError(f"{name} is not an example: give one of {', '.join(EXAMPLES)}")
    text = EXAMPLES[name][0].read_text(encoding="utf-8")
    if output is None:
        click.echo(text, nl=False)
        return
    if output.exists():
        raise ConfigError(f"{output} exists: give another -o, or remove it first")
    write_atomically(output, text.encode(), ConfigError)
    click.echo(f"{output}: {EXAMPLES[name][1]}")


def docs_folder() -> Path:
    """Return the folder of the pages: of the installed package, else of the checkout.

    Raises ConfigError when there is none.
    """
    for folder in (INSTALLED_DOCS, CHECKOUT_DOCS):
        if folder.is_dir():
            return folder
    raise ConfigError(f"{INSTALLED_DOCS}: no such folder: reinstall palpate")


def _title(page: Path) -> str:
    return page.read_text(encoding="utf-8").split("\n", 1)[0].lstrip("# ")
