"""``palpate-host simulate dome``: the paper's Table 2 and Fig. 11, one press, and the library of fields."""

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
MESH = click.option(
    "--mesh",
    type=(click.IntRange(2, 40), click.IntRange(1, 40), click.IntRange(1, 8)),
    default=DEFAULT_MESH,
    show_default=True,
    metavar="CAP SIDE WALL",
    help="Elements along the cap (even), down the side and through the wall.",
)
THETA = click.option(
    "--theta-deg", type=click.FloatRange(0, 85), default=30.0, show_default=True, help="From the pole."
)
DEPTH = click.option("--depth-mm", type=click.FloatRange(0, min_open=True), default=2.0, show_default=True)
ONE_PROBE = click.option("--probe", "probe_name", type=PROBE, default="plate", show_default=True)


@click.group(invoke_without_command=True)
@click.pass_context
def dome(context: click.Context) -> None:
    """The dome by finite elements; without a command, `analysis`. Needs the extra `twin`."""
    try:
        import scipy.sparse  # noqa: F401, PLC0415 (an extra, and slow to import)
    except ImportError:
        raise ConfigError("the finite elements need the extra twin: pip install 'palpate[twin]'") from None
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
    """Table 2's ratios as this dome gives them, and one press on finer and finer meshes."""
    import numpy as np  # noqa: PLC0415 (as below: these load scipy)

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
    click.echo(f"\nMeshes: {probe_name}, theta {theta_deg:g} deg, depth {depth_mm:g} mm, slid by 0.15 of it")
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
    help="Slide towards the base, and along the azimuth.",
)
@ONE_PROBE
@click.option("--picture", type=FILE, help="Draw the press: section and bead sphere (.png, .svg, .pdf).")
def press(
    mesh: tuple[int, int, int],
    theta_deg: float,
    depth_mm: float,
    shear_mm: tuple[float, float],
    probe_name: str,
    picture: Path | None,
) -> None:
    """One press: force on the dome and on its base, centre of pressure, and a picture (Fig. 11)."""
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
    help="May be given many times.",
)
@click.option("--out", type=FILE, help="Where to write  [default: the library that ships with palpate]")
def library(mesh: tuple[int, int, int], probe_names: tuple[str, ...], out: Path | None) -> None:
    """Solves the library of displacement fields again (half an hour of one core)."""
    import numpy as np  # noqa: PLC0415
    from rich.progress import Progress  # noqa: PLC0415

    from palpate_twin.dome import field_grid as grid  # noqa: PLC0415
    from palpate_twin.dome.library import SHIPPED  # noqa: PLC0415
    from palpate_twin.dome.make_library import Domes, LibraryRow, solve_angle, write_library  # noqa: PLC0415

    target = out or SHIPPED
    if not os.access(target.parent, os.W_OK):
        raise ConfigError(f"--out {target}: its folder is missing or cannot be written: give another")
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
@click.option("--seed", default=1, show_default=True, help="Of the random sensors and presses.")
@click.option("--out", type=FILE, help="Where to write  [default: the dome model that ships with palpate]")
def model(seed: int, out: Path | None) -> None:
    """Makes the dome model that calibrations start from, out of the library's fields."""
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


def _resolution(mesh: tuple[int, int, int]) -> Resolution:
    from palpate_twin.dome.mesh import Resolution  # noqa: PLC0415

    return Resolution(*mesh)
