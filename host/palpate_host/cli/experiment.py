"""``palpate-host experiment``: the protocol of Fig. 20, recorded and reported."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.common.atomic_write import make_folder
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.plugins import load_part
from palpate_host.common.plugin_groups import SIMULATORS
from palpate_host.config.packaged import MODELS
from palpate_host.experiment.protocol import cases, load


@click.command()
@click.argument(
    "protocol",
    type=click.Path(path_type=Path, dir_okay=False),
    default=MODELS / "experiment.toml",
    metavar="[EXPERIMENT.TOML]",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("experiment"),
    show_default=True,
    help="Folder for the recordings and the report.",
)
@click.option("--list", "only_list", is_flag=True, help="Print the trials and run none.")
def experiment(protocol: Path, output: Path, only_list: bool) -> None:
    """Turn an object under the proposed and the blind law, from several poses, as in the paper's Fig. 20.

    Every trial leaves its recording in a folder of its own; report.html compares them. The packaged file runs
    on the simulated hand; on a real one the command pauses before each trial for the person who places the
    object, and measures it by the external camera.

    \b
    Examples:
      palpate-host experiment
      palpate-host experiment my-experiment.toml -o run-1
      palpate-host experiment --list
    """
    from rich.progress import Progress  # noqa: PLC0415 (as below: slow to import)

    from palpate_host.experiment.report import write_report  # noqa: PLC0415

    config = load(protocol)
    asked = cases(config)
    if only_list:
        for case in asked:
            click.echo(case.name)
        return
    packaged = MODELS / f"{config.hand}.toml"
    hand_toml = packaged if packaged.exists() else protocol.parent / config.hand
    make_folder(output, ConfigError)
    results = []
    if config.on == "twin":
        run_twin_trial = load_part(SIMULATORS, "trial", "the simulated trial")
        with Progress() as progress:
            task = progress.add_task("trials", total=len(asked))
            for case in asked:
                progress.update(task, description=case.name)
                results.append(run_twin_trial(hand_toml, config, case, output / case.name))
                progress.advance(task)
    else:
        from palpate_host.experiment.hand_trial import run_hand_trial  # noqa: PLC0415

        for number, case in enumerate(asked, start=1):
            click.echo(f"trial {number} of {len(asked)}: {case.turn.name}, {case.law.value} law")
            click.pause(
                f"object {case.pose.name}. {case.pose.instruction} Then any key; catch it at the end: "
            )
            results.append(run_hand_trial(hand_toml, config, case, output / case.name))
    page = write_report(output, config, results)
    click.echo((output / "report.md").read_text(encoding="utf-8"))
    click.echo(f"{page}")
