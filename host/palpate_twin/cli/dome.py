"""Commands ``palpate-host simulate dome``: the paper's Table 2 and Fig. 11, a press, the field library."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate_edge.common.errors import ConfigError
from palpate_twin.dome.probe import Probe

if TYPE_CHECKING:
    from palpate_twin.dome.mesh import Resolution

FILE = click.Path(path_type=Path, dir_okay=False, writable=True)
PROBES = {probe.label: probe for probe in Probe}
PROBE = click.Choice(list(PROBES))
DEFAULT_MESH = (8, 6, 2)
TWIST_MESH = (6, 4, 1)  # twists are differences, in which most of the mesh's error is left out
MESH = click.option(
    "--mesh",
    type=(click.IntRange(2, 40), click.IntRange(1, 40), click.IntRange(1, 8)),
    default=DEFAULT_MESH,
    show_default=True,
    metavar="CAP SIDE WALL",
    help="Number of elements along the cap (even), down the side and through the wall.",
)
THETA = click.option(
    "--theta-deg",
    type=click.FloatRange(0, 85),
    default=30.0,
    show_default=True,
    help="Polar angle of the contact, measured from the pole.",
)
DEPTH = click.option(
    "--depth-mm",
    type=click.FloatRange(0, min_open=True),
    default=2.0,
    show_default=True,
    help="Indentation of the probe.",
)
ONE_PROBE = click.option(
    "--probe",
    "probe_name",
    type=PROBE,
    default="plate",
    show_default=True,
    help="Probe that presses the dome.",
)


@click.group(invoke_without_command=True)
@click.pass_context
def dome(context: click.Context) -> None:
    """Compute the dome's deformation by finite elements. Without a command, run `analysis`.

    Needs the extra `twin`.

    \b
    Examples:
      palpate-host simulate dome
      palpate-host simulate dome press --theta-deg 45 --depth-mm 2 --picture press.png
    """
    if context.invoked_subcommand is None:
        context.invoke(analysis)


@dome.command()
@MESH
@THETA
@DEPTH
@ONE_PROBE
def analysis(
    mesh: tuple[int, int, int] = DEFAULT_MESH,
    theta_deg: float = 30.0,
    depth_mm: float = 2.0,
    probe_name: str = "plate",
) -> None:
    """Print the ratios of the paper's Table 2.

    One press on meshes of increasing resolution follows.

    \b
    Example:
      palpate-host simulate dome analysis --mesh 4 3 1
    """
    import numpy as np  # noqa: PLC0415 (as below: keeps --help fast)

    from palpate_twin.dome.convergence import converge  # noqa: PLC0415
    from palpate_twin.dome.equilibrium import ElasticDome  # noqa: PLC0415
    from palpate_twin.dome.mesh import dome_mesh  # noqa: PLC0415
    from palpate_twin.dome.side_points import FORCE_PER_MU_MM2, TABLE_2, side_points  # noqa: PLC0415

    click.echo(f"Side points on the bead sphere, plate, {FORCE_PER_MU_MM2:g} mm^2 times mu (Table 2)")
    click.echo("contact angle  depth mm  before mm  after mm  ratio  paper")
    for pair in side_points(ElasticDome(dome_mesh(resolution=_resolution(mesh), half=True))):
        click.echo(
            f"{pair.contact_angle_deg:10d} deg  {pair.depth_mm:8.2f}  {pair.before_mm:9.2f}"
            f"  {pair.after_mm:8.2f}  {pair.ratio:.3f}  {TABLE_2[pair.contact_angle_deg]:.3f}"
        )
    click.echo(
        f"\nMeshes: {probe_name}, theta {theta_deg:g} deg, depth {depth_mm:g} mm, slide 0.15 of the depth"
    )
    click.echo("cap side wall  unknowns  force mm^2 mu  |contact+base|/|contact|  field rms um")
    for result in converge(float(np.radians(theta_deg)), depth_mm, PROBES[probe_name]):
        size = result.resolution
        click.echo(
            f"{size.cap:3d} {size.side:4d} {size.wall:4d}  {result.unknowns:8d}"
            f"  {result.force_per_mu_mm2:13.4f}  {result.imbalance:24.1e}  {1000 * result.field_rms_mm:12.1f}"
        )


@dome.command()
@MESH
@THETA
@DEPTH
@click.option(
    "--shear-mm",
    type=(float, float),
    default=(0.0, 0.0),
    show_default=True,
    help="Slide after the press: towards the base, along the azimuth.",
)
@ONE_PROBE
@click.option(
    "--picture", type=FILE, help="File for a drawing of section and bead sphere (.png, .svg, .pdf)."
)
def press(
    mesh: tuple[int, int, int],
    theta_deg: float,
    depth_mm: float,
    shear_mm: tuple[float, float],
    probe_name: str,
    picture: Path | None,
) -> None:
    """Compute one press.

    The results are the forces on dome and base, the centre of pressure, and a picture (Fig. 11).

    \b
    Example:
      palpate-host simulate dome press --theta-deg 45 --depth-mm 2 --picture press.png
    """
    import numpy as np  # noqa: PLC0415

    from palpate_twin.dome import press as pressing  # noqa: PLC0415
    from palpate_twin.dome.equilibrium import ElasticDome  # noqa: PLC0415
    from palpate_twin.dome.mesh import dome_mesh  # noqa: PLC0415
    from palpate_twin.dome.picture import draw_press  # noqa: PLC0415

    model = ElasticDome(dome_mesh(resolution=_resolution(mesh), half=shear_mm[1] == 0))
    pressed = pressing.press(model, float(np.radians(theta_deg)), depth_mm, PROBES[probe_name], shear_mm)
    for name, vector in {
        "force on the dome, mm^2 mu": pressed.force_per_mu_mm2,
        "force of the base, mm^2 mu": pressed.base_per_mu_mm2,
        "first touch, mm": pressed.touch_mm,
        "centre of pressure, mm": pressed.pressure_centre_mm,
    }.items():
        click.echo(f"{name:28s}" + "".join(f"{component:11.4f}" for component in vector))
    click.echo(f"{'largest pressure, mu':28s}{pressed.largest_pressure:11.4f}")
    if picture:
        draw_press(model.mesh, pressed, picture)


@dome.command()
@MESH
@click.option(
    "--probe",
    "probe_names",
    type=PROBE,
    multiple=True,
    default=("plate", "sphere5"),
    show_default=True,
    help="Probe to solve for; may be repeated.",
)
@click.option("--out", type=FILE, help="File to write.  [default: the library in the package]")
def library(mesh: tuple[int, int, int], probe_names: tuple[str, ...], out: Path | None) -> None:
    """Solve the library of displacement fields.

    This takes half an hour on one core.

    \b
    Example:
      palpate-host simulate dome library --out fields.npz
    """
    import numpy as np  # noqa: PLC0415
    from rich.progress import Progress  # noqa: PLC0415

    from palpate_twin.dome import field_grid as grid  # noqa: PLC0415
    from palpate_twin.dome.library import SHIPPED  # noqa: PLC0415
    from palpate_twin.dome.make_library import Domes, LibraryRow, solve_angle, write_library  # noqa: PLC0415

    target = out or SHIPPED
    if not os.access(target.parent, os.W_OK):
        raise ConfigError(f"--out {target}: the folder {target.parent} does not exist or is not writable")
    resolution = _resolution(mesh)
    domes = Domes(30.0, 5.0, resolution, grid.BEAD_RADIUS_MM * grid.ring_directions())
    probes = [PROBES[name] for name in dict.fromkeys(probe_names)]
    rows: list[LibraryRow] = []
    with Progress() as progress:
        task = progress.add_task("presses", total=len(probes) * len(grid.THETA_DEG) * grid.CASES)
        for probe in probes:
            for theta_rad in np.radians(grid.THETA_DEG):
                progress.update(task, description=f"{probe.label} {np.degrees(theta_rad):.0f} deg")
                rows += solve_angle(domes, float(theta_rad), probe, lambda: progress.advance(task))
    write_library(target, rows, domes, resolution)
    click.echo(f"{target}: {len(rows)} presses")


@dome.command()
@click.option(
    "--mesh",
    type=(click.IntRange(2, 40), click.IntRange(1, 40), click.IntRange(1, 8)),
    default=TWIST_MESH,
    show_default=True,
    metavar="CAP SIDE WALL",
    help="Number of elements along the cap (even), down the side and through the wall.",
)
@click.option("--out", type=FILE, help="File to write.  [default: the twist library in the package]")
def twists(mesh: tuple[int, int, int], out: Path | None) -> None:
    """Solve the library of twists of the probe about the contact normal.

    This takes five minutes on one core.

    \b
    Example:
      palpate-host simulate dome twists --out twists.npz
    """
    import numpy as np  # noqa: PLC0415
    from rich.progress import Progress  # noqa: PLC0415

    from palpate_twin.dome import field_grid as grid  # noqa: PLC0415
    from palpate_twin.dome.make_library import Domes  # noqa: PLC0415
    from palpate_twin.dome.make_twists import AngleTwists, solve_twists, write_twists  # noqa: PLC0415
    from palpate_twin.dome.twist_library import SHIPPED, TWISTED  # noqa: PLC0415

    target = out or SHIPPED
    if not os.access(target.parent, os.W_OK):
        raise ConfigError(f"--out {target}: the folder {target.parent} does not exist or is not writable")
    resolution = _resolution(mesh)
    domes = Domes(30.0, 5.0, resolution, grid.BEAD_RADIUS_MM * grid.ring_directions())
    probes = [Probe.PLATE, Probe.SPHERE5]
    rows: list[AngleTwists] = []
    with Progress() as progress:
        task = progress.add_task("twists", total=len(probes) * len(grid.THETA_DEG) * len(TWISTED))
        for probe in probes:
            for theta_rad in np.radians(grid.THETA_DEG):
                progress.update(task, description=f"{probe.label} {np.degrees(theta_rad):.0f} deg")
                rows.append(solve_twists(domes, float(theta_rad), probe, lambda: progress.advance(task)))
    write_twists(target, probes, rows, domes, resolution)
    click.echo(f"{target}: {len(rows)} contact angles")


@dome.command()
@click.option("--seed", default=1, show_default=True, help="Random seed of sensors and presses.")
@click.option("--out", type=FILE, help="File to write.  [default: the dome model in the package]")
def model(seed: int, out: Path | None) -> None:
    """Create the dome model from the library's fields.

    Calibrations start from this model.

    \b
    Example:
      palpate-host simulate dome model --out dome-model.npz
    """
    from rich.progress import Progress  # noqa: PLC0415

    from palpate_edge.calibration.training.dome_model import SHIPPED, save_dome_model  # noqa: PLC0415
    from palpate_twin.dome.dome_samples import dome_samples  # noqa: PLC0415
    from palpate_twin.dome.library import load_library  # noqa: PLC0415

    with Progress() as progress:
        task = progress.add_task("sensors", total=None)
        samples = dome_samples(
            load_library(), seed, lambda done, total: progress.update(task, completed=done, total=total)
        )
    target = out or SHIPPED
    save_dome_model(samples, target)
    click.echo(f"{target}: {len(samples.fields)} samples")


@dome.command()
@click.option("--samples", default=1500, show_default=True, help="Number of motions.")
@click.option("--seed", default=1, show_default=True, help="Random seed of the motions.")
@click.option("--out", type=FILE, help="File to write.  [default: the ball model in the package]")
def ball(samples: int, seed: int, out: Path | None) -> None:
    """Create the press rig's ball model from the library's forces.

    \b
    Example:
      palpate-host simulate dome ball --out ball-forces.npz
    """
    from palpate_edge.press_rig.ball_model import SHIPPED, fit_ball_model, save_ball_model  # noqa: PLC0415
    from palpate_twin.dome.library import load_library  # noqa: PLC0415
    from palpate_twin.press_rig.ball_samples import ball_samples  # noqa: PLC0415

    target = out or SHIPPED
    save_ball_model(fit_ball_model(*ball_samples(load_library(), samples, seed)), target)
    click.echo(f"{target}: {samples} motions")


def _resolution(mesh: tuple[int, int, int]) -> Resolution:
    from palpate_twin.dome.mesh import Resolution  # noqa: PLC0415

    return Resolution(*mesh)
