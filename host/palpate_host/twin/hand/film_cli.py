"""``palpate-host simulate film``: what a simulated hand did, as a film."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="hand.toml with [twin].",
)
@click.option(
    "--motion",
    "motion_path",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="motion.csv of `simulate live` or of the demo (run/truth/).",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="The film, .webp; a picture of it every few seconds goes beside it as .png.",
)
@click.option(
    "--rate", type=click.FloatRange(1, 50), default=10.0, show_default=True, help="Pictures a second."
)
@click.option("--plain", is_flag=True, help="Draw without OpenGL.")
def film(config_path: Path, motion_path: Path, output: Path, rate: float, plain: bool) -> None:
    """Draws a hand's motion. Without a display OpenGL needs MUJOCO_GL=egl or osmesa, --plain neither.

    \b
    MUJOCO_GL=egl palpate-host simulate film --config demo/run/hand.toml \\
      --motion demo/run/truth/motion.csv -o hand.webp
    """
    import numpy as np  # noqa: PLC0415 (as below: what --help need not wait for)

    from palpate_host import hand_config  # noqa: PLC0415
    from palpate_host.twin.hand.film import draw_states, write_film, write_row  # noqa: PLC0415
    from palpate_host.twin.hand.motion import film_rows, read_motion  # noqa: PLC0415
    from palpate_host.twin.hand.twin_model import twin_model  # noqa: PLC0415

    twin = twin_model(hand_config.load(config_path), with_contacts=False)
    motion = read_motion(motion_path)
    states = []
    for row in film_rows(motion, rate):
        qpos = np.zeros(twin.model.nq)
        qpos[twin.q_address] = motion.q_rad[row]
        qpos[twin.object_q : twin.object_q + 7] = motion.pose[row]
        states.append(qpos)
    pictures = draw_states(twin, states, (360, 480), plainly=plain)
    write_film(output, pictures, round(1000 / rate))
    stills = np.linspace(0, len(pictures) - 1, 6).round().astype(int)
    write_row(output.with_suffix(".png"), [pictures[index] for index in stills])
    click.echo(f"{output}: {len(pictures)} pictures, drawn {'plainly' if plain else 'by OpenGL'}")
