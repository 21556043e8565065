"""Command ``palpate-host simulate film``: a film of a simulated hand."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.common.errors import ConfigError
from palpate_twin.cli.options import FILE, FOLDER, config_option

STILLS, COLUMNS = 6, 3
HEIGHT_PX, WIDTH_PX = 360, 480  # of the hand's part of the film


@click.command()
@config_option("hand.toml with [twin].")
@click.option(
    "--motion",
    "motion_path",
    type=FILE,
    required=True,
    help="motion.csv of `simulate live` or of the demo (run/truth/).",
)
@click.option(
    "-o",
    "--output",
    type=FILE,
    required=True,
    help="Film to write (.webp). Six stills with roll, pitch, yaw are written next to it (.png).",
)
@click.option(
    "--rate", type=click.FloatRange(1, 50), default=10.0, show_default=True, help="Frames per second."
)
@click.option(
    "--longest",
    "longest_s",
    type=click.FloatRange(1, 600),
    default=60.0,
    show_default=True,
    metavar="SECONDS",
    help="Longest film; of a longer motion, the beginning is shown. Each frame takes 0.5 MB of memory.",
)
@click.option("--plain", is_flag=True, help="Use the plain renderer, which needs no OpenGL.")
@click.option(
    "--run",
    "run_path",
    type=FOLDER,
    help="Run folder of the demo: beside the hand, the film shows what a fingertip saw and published.",
)
@click.option(
    "--finger", metavar="NAME", help="Fingertip of --run.  [default: the one whose contact moves most]"
)
def film(
    config_path: Path,
    motion_path: Path,
    output: Path,
    rate: float,
    longest_s: float,
    plain: bool,
    run_path: Path | None,
    finger: str | None,
) -> None:
    """Make a film of a simulated hand's motion at its original speed.

    Without a display, OpenGL needs MUJOCO_GL=egl or osmesa; --plain works without.

    \b
    Example:
      palpate-host demo --lockstep
      MUJOCO_GL=egl palpate-host simulate film --config demo/run/hand.toml \\
        --motion demo/run/truth/motion.csv --run demo/run -o hand.webp
    """
    import numpy as np  # noqa: PLC0415 (as below: keeps --help fast)

    from palpate_host.common.rotation import to_rpy_deg  # noqa: PLC0415
    from palpate_host.config import hand_reader  # noqa: PLC0415
    from palpate_twin.demo.fingertip_film import busiest_finger, draw_sights  # noqa: PLC0415
    from palpate_twin.demo.run_folder import RunFolder  # noqa: PLC0415
    from palpate_twin.hand.film import draw_states, label, write_film, write_grid  # noqa: PLC0415
    from palpate_twin.hand.motion import film_cut, read_motion  # noqa: PLC0415
    from palpate_twin.hand.twin_model import twin_model  # noqa: PLC0415

    hand = hand_reader.load(config_path)
    twin = twin_model(hand, with_contacts=False)
    motion = read_motion(motion_path)
    states = []
    cut = film_cut(motion, rate, longest_s)
    rows = cut.rows
    for row in rows:
        qpos = np.zeros(twin.model.nq)
        qpos[twin.q_address] = motion.q_rad[row]
        qpos[twin.object_q : twin.object_q + 7] = motion.pose[row]
        states.append(qpos)
    pictures = draw_states(twin, states, (HEIGHT_PX, WIDTH_PX), plainly=plain)
    scenes = pictures
    if run_path is not None:
        names = [each.name for each in hand.fingers]
        if finger is not None and finger not in names:
            raise ConfigError(f"--finger {finger}: the hand has {', '.join(names)}: give one of them")
        folder = RunFolder(run_path.resolve())
        chosen_finger = finger or busiest_finger(folder, names)
        seen = draw_sights(folder, chosen_finger, motion.stamps_us[rows].tolist(), HEIGHT_PX)
        scenes = [np.hstack([sight, scene]) for sight, scene in zip(seen, pictures, strict=True)]
    write_film(output, scenes, round(1000 / rate))
    chosen = np.linspace(0, len(pictures) - 1, STILLS).round().astype(int)
    turns = motion.rotations @ motion.rotations[0].T
    stills = []
    for index in chosen:
        roll, pitch, yaw = (f"{angle + 0.0:.0f}" for angle in np.round(to_rpy_deg(turns[rows[index]])))
        seconds = (motion.stamps_us[rows[index]] - motion.stamps_us[rows[0]]) / 1e6
        stills.append(label(pictures[index], f"{seconds:.0f} s: {roll}, {pitch}, {yaw} deg"))
    write_grid(output.with_suffix(".png"), stills, COLUMNS)
    part = f"the first {longest_s:g} of {cut.whole_s:.1f} s, " if cut.whole_s > longest_s else ""
    renderer = "the plain renderer" if plain else "OpenGL"
    click.echo(f"{output}: {len(pictures)} pictures, {part}drawn by {renderer}")
