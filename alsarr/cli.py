"""The command line of alsarr.

Only what the help needs is imported at the top; everything that computes is imported by
the command that uses it.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, TYPE_CHECKING

import typer

from camojab import _command as command
from camojab.cli import Constants, Encoding, Statement

from ._capture_command import capture
from ._compare_command import compare
from ._evaluate_command import evaluate
from ._explore_command import explore
from ._export_command import export
from ._predict_command import predict
from ._preview_command import preview
from ._refresh_command import refresh
from ._score_command import score
from ._train_command import train


if TYPE_CHECKING:
    from ._inputs import Inputs
    from ._run import Outcome

    Context = typer.Context
else:
    # What typer passes is of this class, not of the one that it asks to be named.
    Context = typer.Context.__base__


app = typer.Typer(add_completion=False)
tables_app = typer.Typer(add_completion=False)
app.add_typer(tables_app, name="tables")
app.command()(compare)
app.command()(export)
app.command()(preview)
app.command()(refresh)
app.command()(capture)
app.command()(train)
app.command()(score)
app.command()(evaluate)
app.command()(predict)
app.command()(explore)

Budget = Annotated[
    float,
    typer.Option(help="Share of the cost of full rate everywhere, in (0, 1]."),
]

Solver = Annotated[
    Literal["lagrangian", "hull", "greedy", "dynamic-programme"],
    typer.Option(
        help="The price of a pixel; the same by hulls and a sort; the paper's "
        "Algorithm 1; or the best there is, which takes seconds."
    ),
]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv`, or that of the process; returns the exit status.

    0 done, 1 the data cannot be used, 2 the command line is wrong, 130 interrupted.
    """
    return command.run(app, "alsarr", argv)


def _print_version(context: Any, asked: bool) -> bool:
    return command.print_version("alsarr", asked, context.params["verbose"])


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, help="Print the version and leave."
        ),
    ] = False,
    verbose: command.Verbose = False,
) -> None:
    """Shading and refresh rates that buy the most quality for a budget."""
    command.check_verbose(verbose)


@app.command()
def run(
    data: Annotated[
        Literal["builtin", "jindal2021"],
        typer.Option(
            help="Built-in textures with simulated votes and a drawn frame, or the "
            "votes, textures and SciFi frame of Jindal et al. 2021."
        ),
    ] = "builtin",
    budget: Budget = 0.25,
    solver: Solver = "greedy",
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder to write into.")
    ] = Path("out"),
    luminance: Annotated[
        float,
        typer.Option(
            help="Luminance of the SciFi frame in cd/m^2; its own was not published."
        ),
    ] = 50.0,
    ppd: Annotated[
        float, typer.Option(help="Pixels per degree of the frame's display.")
    ] = 60.0,
    refresh_rate: Annotated[
        float, typer.Option(help="Refresh rate of the frame's display [Hz].")
    ] = 60.0,
) -> None:
    """Votes to constants, constants to tables, tables to a rate map.

    Writes parameters.json, tables.json, rates.png, rates.bin and report.html.
    What did not change since the last run into the same folder is not done again.
    """
    if output.exists() and not output.is_dir():
        raise command.Unusable(f"{output}: must be a folder to write into.")
    with _usable(), command.stages() as progress:
        from camojab import Display

        from ._inputs import builtin_inputs, jindal2021_inputs
        from ._run import check_budget, run as job

        check_budget(budget)
        Display(ppd=ppd, refresh_rate=refresh_rate, luminance=luminance)

        progress("data", 0, 1)
        if data == "builtin":
            inputs = builtin_inputs(ppd=ppd, refresh_rate=refresh_rate)
        else:
            inputs = jindal2021_inputs(
                ppd=ppd, refresh_rate=refresh_rate, frame_luminance=luminance
            )
        progress("data", 1, 1)
        outcome = job(inputs, output, budget=budget, solver=solver, progress=progress)
    _print_outcome(inputs, outcome, output)


@app.command()
def solve(
    quality: Annotated[
        Path,
        typer.Argument(help="NPZ file with quality_jnd (tiles, 7) and cost (7)."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The NPZ file to write, whole.")
    ],
    budget: Budget = 0.25,
    solver: Solver = "lagrangian",
) -> None:
    """Choose a shading rate for every tile.

    The seven rates are 4x4, 2x4, 4x2, 2x2, 1x2, 2x1, 1x1 (width x height of the
    coarse pixel). Written are rate (an index for each tile), quality_jnd and
    cost (totals), and gap_jnd, by how much a better choice could surpass this one
    at the most.
    """
    with _usable():
        from ._rate_choice import choose, save_choice

        if output.is_dir():
            raise ValueError(f"{output}: must be a file to write, got a folder.")
        chosen = choose(quality, budget, solver)
        save_choice(output, chosen)
    total = f"{float(chosen.quality):.6g} JND for a cost of {float(chosen.cost):g}"
    gap = f"at most {float(chosen.gap):.3g} JND below the best choice"
    print(f"{output}: {chosen.rate.size} tiles, {total}, {gap}")


@tables_app.callback(invoke_without_command=True)
def tables(
    context: Context,
    textures: Annotated[
        str | None,
        typer.Option(
            help="Folder of images or .npy files, in the order of their names that of "
            "the frames' texture indices; or builtin or jindal2021."
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="The file to write, whole: .json or .npz."),
    ] = None,
    frames: Annotated[
        list[Path] | None,
        typer.Option(
            help="NPZ files of frames (texture, mip_level, velocity_x, velocity_y, "
            "luminance, a value a tile). Only what occurs in them is distilled; with "
            "none, 12 levels, 0 to 50 deg/s and 0.1 to 316 cd/m^2."
        ),
    ] = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Largest error that is good enough [JND]: the cheapest form with no "
            "more is taken, and textures that no rate changes by more are constants."
        ),
    ] = None,
    form: Annotated[
        Literal["eq31", "eq31-two-step", "eq31-log-travel"] | None,
        typer.Option(
            help="Of the polynomials. By default what --tolerance needs, or eq31."
        ),
    ] = None,
    constraint: Annotated[
        Literal["gain", "monotone"] | None,
        typer.Option(
            help="Keep every rate at least as good as the coarsest, or as every "
            "coarser one."
        ),
    ] = None,
    rates: Annotated[
        str,
        typer.Option(
            help="Rates that the hardware has, with commas between them, or separable "
            "for a polynomial of each axis alone."
        ),
    ] = "4x4,2x4,4x2,2x2,1x2,2x1,1x1",
    absolute: Annotated[
        bool,
        typer.Option(
            "--absolute", help="The model's own quality, relative to no rate."
        ),
    ] = False,
    ppd: Annotated[
        float, typer.Option(help="Pixels per degree of the display.")
    ] = 60.0,
    persistence: Annotated[
        float, typer.Option(help="Share of a frame that the display is lit, in (0, 1].")
    ] = 1.0,
    refresh_rate: Annotated[
        tuple[float, float],
        typer.Option(help="Lowest and highest refresh rate of the display [Hz]."),
    ] = (30.0, 120.0),
    formulation: Statement = None,
    parameters: Constants = None,
    encoding: Encoding = None,
    cells: Annotated[
        int,
        typer.Option(help="Energies that stand for a texture while it is sampled."),
    ] = 5000,
    coordinator: Annotated[
        str | None,
        typer.Option(help="HOST:PORT of the first of several processes."),
    ] = None,
    processes: Annotated[
        int, typer.Option(help="With --coordinator: how many processes.")
    ] = 1,
    process: Annotated[
        int, typer.Option(help="With --coordinator: which of them this is, from 0.")
    ] = 0,
) -> None:
    """Distil the model into tables that an engine evaluates; or show such tables.

    An interrupted run goes on where it was when it is started again.
    """
    if context.invoked_subcommand is not None:
        return
    if textures is None or output is None:
        missing = "--textures" if textures is None else "--output"
        raise typer.BadParameter("is needed.", param_hint=f"'{missing}'")
    with _usable():
        import jax

        from . import _tables_command as job

        # Single precision misses the model by 1e-4 JND and takes a third of the time.
        with jax.enable_x64(False), job.processes(coordinator, processes, process):
            job.make(
                textures=textures,
                frames=frames or [],
                output=output,
                tolerance=tolerance,
                form=form,
                constraint=constraint,
                rates=rates,
                absolute=absolute,
                ppd=ppd,
                persistence=persistence,
                refresh_rate=refresh_rate,
                formulation=formulation,
                parameters=parameters,
                encoding=encoding,
                cells=cells,
            )


@tables_app.command()
def show(
    file: Annotated[Path, typer.Argument(help="Tables, .json or .npz.")],
) -> None:
    """Print what tables are of, and how far they can be trusted."""
    with _usable():
        from ._tables_command import show as job

        job(file)


def _print_outcome(inputs: "Inputs", outcome: "Outcome", output: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from ._report import fit_rows

    console = Console()
    rows = fit_rows(inputs, outcome.fit)
    columns = ["block", "RMSE [JND]"]
    columns += ["Table 5", "published digits"] if inputs.published else []
    table = Table(*columns, title=f"Fit to {inputs.name}", title_justify="left")
    for row in rows:
        table.add_row(*row[: len(columns)])
    console.print(table)
    *blocks, total = (value for _, value, _, _ in rows)
    print(f"RMSE [JND]: {' '.join(blocks)}, all {total}")
    tables, chosen = outcome.tables, outcome.rate_map
    print(
        f"tables: {len(tables['textures'])} textures x {len(tables['mip_levels'])} mip "
        f"levels, error against the model: largest "
        f"{tables['largest_error_jnd']:.3g} JND, median "
        f"{tables['median_error_jnd']:.3g} JND"
    )
    shares = ", ".join(f"{k} {v:.1%}" for k, v in chosen["shares"].items())
    print(
        f"rate map: {chosen['quality_jnd']:.2f} JND over {chosen['tiles']} tiles for "
        f"{chosen['cost'] / chosen['full_cost']:.2%} of full cost (budget "
        f"{chosen['budget']:.2%}); {shares}"
    )
    print(
        f"solver: {chosen['solver']}, at most {chosen['gap_jnd']:.3g} JND "
        f"({chosen['gap_jnd'] / max(chosen['quality_jnd'], 1e-9):.2g} of it) below the "
        "best map"
    )
    print(f"to quote: {outcome.quote}")
    done = ", ".join(outcome.computed) or "nothing, all is up to date"
    print(f"computed: {done}; see {output / 'report.html'}")


@contextmanager
def _usable() -> Iterator[None]:
    """What the library says of a wrong value, without a traceback."""
    import equinox as eqx

    try:
        yield
    except (ValueError, eqx.EquinoxRuntimeError) as error:
        raise command.Unusable(str(error).splitlines()[0]) from error
