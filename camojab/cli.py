"""The command line of camojab.

Only what the help needs is imported at the top; everything that computes is imported by
the command that uses it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ._command import (
    check_verbose,
    precision as bits,
    print_version,
    run,
    stages,
    Study,
    Verbose,
)


app = typer.Typer(add_completion=False)

Precision = Annotated[
    Literal["32", "64"],
    typer.Option(help="Bits of the numbers that the model computes with."),
]
Output = Annotated[
    Path, typer.Option("-o", "--output", help="The CSV file to write, whole.")
]
Folder = Annotated[
    Path, typer.Option("-o", "--output", help="Folder to write into; made if need be.")
]
Encoding = Annotated[
    str | None,
    typer.Option(
        help="How the values of image files stand for light: 'linear', 'sRGB' or "
        "another name that colour-science knows. Colour needs it; without it grey is "
        "relative luminance as it stands."
    ),
]
Votes = Annotated[
    Path | None,
    typer.Option(
        help="CSV file of votes: observer, condition_a, condition_b, a_preferred."
    ),
]
Conditions = Annotated[
    Path | None,
    typer.Option(
        help="With --votes: CSV file with a row for each condition, in the columns of "
        "camojab predict and the column condition, its name."
    ),
]
Textures = Annotated[
    Path | None,
    typer.Option(help="With --votes: the folder that paths of textures begin from."),
]
Published = Annotated[
    Literal["jindal2021"] | None,
    typer.Option(
        help="Published data, in the place of --votes; what is taken if none."
    ),
]
Constants = Annotated[
    Path | None,
    typer.Option(
        "--parameters",
        help="JSON file of fitted constants. By default the published ones.",
    ),
]

Statement = Annotated[
    Literal["released", "paper"] | None,
    typer.Option(
        help="The authors' program or the equations as printed. By default that "
        "of --parameters, or else released."
    ),
]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line `argv`, or that of the process; returns the exit status.

    0 done, 1 the data cannot be used, 2 the command line is wrong, 130 interrupted.
    """
    return run(app, "camojab", argv)


def _print_version(context: Any, asked: bool) -> bool:
    return print_version("camojab", asked, context.params["verbose"])


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, help="Print the version and leave."
        ),
    ] = False,
    verbose: Verbose = False,
) -> None:
    """Judder, aliasing and blur of moving, coarsely shaded textures, in JND."""
    check_verbose(verbose)


@app.command()
def predict(
    conditions: Annotated[Path, typer.Argument(help="CSV file, one condition a row.")],
    output: Output,
    formulation: Statement = None,
    precision: Precision = "64",
    parameters: Constants = None,
    encoding: Encoding = None,
    tolerance: Annotated[
        float,
        typer.Option(
            min=0,
            help="Error of a quality that may be made for speed [JND]: many rows that "
            "share texture, mip level and rates then take a microsecond each.",
        ),
    ] = 0.0,
) -> None:
    """Predict distortions and quality (JND) for every row of a table.

    Columns: texture, mean_luminance_cd_m2, refresh_rate_hz, velocity_deg_s,
    persistence, ppd, rate_x, rate_y, mip_level; optionally beta, and vrs,
    eye_blur, judder (0 or 1). Others are kept as they are. Added are
    spatial_distortion, temporal_distortion, quality_jnd.

    A texture is the path of an image or .npy file (from the working folder, or
    else from the table's), jindal2021:NAME for a published one such as grass,
    or builtin:NAME for one such as brick.
    """
    with bits(precision):
        from ._table_command import predict

        predict(
            conditions=conditions,
            output=output,
            formulation=formulation,
            parameters=parameters,
            encoding=encoding,
            tolerance=tolerance,
        )


@app.command()
def sensitivity(
    table: Annotated[Path, typer.Argument(help="CSV file, one grating a row.")],
    output: Output,
    precision: Precision = "64",
) -> None:
    """Contrast sensitivity for every row of a table.

    Columns: spatial_frequency_cpd, temporal_frequency_hz, luminance_cd_m2.
    Others are kept as they are. Added is sensitivity.
    """
    with bits(precision):
        from ._table_command import sensitivity

        sensitivity(table=table, output=output)


@app.command()
def scale(
    output: Folder,
    votes: Votes = None,
    data: Annotated[
        Literal["jindal2021", "denes2020", "simulated"] | None,
        typer.Option(help="Published votes, in the place of --votes."),
    ] = None,
    by: Annotated[
        str | None,
        typer.Option(
            help="Columns, with commas between them, that tell apart groups of "
            "conditions which were never compared with each other."
        ),
    ] = None,
    prior: Annotated[
        Literal["none", "gaussian", "bounded"] | None,
        typer.Option(
            help="What keeps unanimous votes from an infinite scale. By default none, "
            "or what the authors of --data used."
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(help="Condition of 0 JND; by default the mean of each group."),
    ] = None,
    bootstrap: Annotated[
        int,
        typer.Option(min=0, help="Resamples of the observers behind the intervals."),
    ] = 1000,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1)] = 0,
) -> None:
    """Scale pairwise votes to JND, with intervals.

    Writes scale.json, scale.csv and report.html: JND of every condition with its
    interval, how far each observer is from the others, how well one scale explains
    the votes, and the residual of every pair.
    """
    if (votes is None) == (data is None):
        raise typer.BadParameter("give one of the two.", param_hint="--votes or --data")
    if bootstrap == 1:
        raise typer.BadParameter("must be 0 or >= 2.", param_hint="'--bootstrap'")
    with bits("64"), stages() as progress:
        from ._scale_command import scale

        scale(
            file=votes,
            data=data,
            by=by,
            prior=prior,
            reference=reference,
            resamples=bootstrap,
            seed=seed,
            output=output,
            progress=progress,
        )


@app.command()
def compare(
    output: Folder,
    data: Published = None,
    votes: Votes = None,
    conditions: Conditions = None,
    textures: Textures = None,
    encoding: Encoding = None,
    parameters: Constants = None,
) -> None:
    """Compare CaMoJAB, MARRR and NAS on the same measurements.

    Writes compare.json, compare.csv and report.html: what each model leaves of each
    block of Table 5 of Jindal et al. 2021, or of one's own votes, with every
    assumption stated, and what CaMoJAB leaves when it is refitted without its parts.
    """
    own = _own_study(data, votes, conditions, textures, encoding)
    with bits("64"), stages() as progress:
        from ._compare_command import compare

        compare(
            own=own,
            parameters=parameters,
            output=output,
            progress=progress,
        )


@app.command()
def validate(
    output: Folder,
    data: Published = None,
    votes: Votes = None,
    conditions: Conditions = None,
    textures: Textures = None,
    encoding: Encoding = None,
    parameters: Constants = None,
) -> None:
    """Put constants to the test on data that they were not fitted to.

    Writes validate.json, validate.csv and report.html: agreement with the opinion
    scores of Mackin et al. 2016 and ITU-R BT.2246 and the preferences of Experiment 2
    of Jindal et al. 2021, or agreement with one's own votes.
    """
    own = _own_study(data, votes, conditions, textures, encoding)
    with bits("64"), stages() as progress:
        from ._validate_command import validate

        validate(
            own=own,
            parameters=parameters,
            output=output,
            progress=progress,
        )


@app.command()
def fit(
    output: Folder,
    data: Annotated[
        Literal["jindal2021", "simulated"] | None,
        typer.Option(help="Published or simulated data, in the place of --votes."),
    ] = None,
    votes: Votes = None,
    conditions: Conditions = None,
    textures: Textures = None,
    encoding: Encoding = None,
    to: Annotated[
        Literal["jnd", "votes"] | None,
        typer.Option(
            help="Least squares on JND, or maximum likelihood of the votes themselves. "
            "By default JND for --data and votes for --votes."
        ),
    ] = None,
    free: Annotated[
        str,
        typer.Option(
            help="Constants to fit, with commas between them: ws, wt, beta, ca, cb, "
            "mipmap_width, hold_width, pursuit_width, achromatic_gain, red_green_gain, "
            "yellow_violet_gain, velocity_gain, scale:DATA_SET, scales (all but the "
            "first), lapse (of votes)."
        ),
    ] = "ws,wt,beta,scales",
    formulation: Annotated[
        Literal["released", "paper"] | None,
        typer.Option(help="By default that of --parameters, or else released."),
    ] = None,
    solver: Annotated[
        Literal[
            "levenberg-marquardt",
            "scoring",
            "dogleg",
            "gauss-newton",
            "bfgs",
            "jaxopt-levenberg-marquardt",
            "jaxopt-lbfgsb",
        ]
        | None,
        typer.Option(help="By default the first for JND and the second for votes."),
    ] = None,
    parameters: Annotated[
        Path | None,
        typer.Option(help="JSON file of constants to start from, or to hold."),
    ] = None,
    bootstrap: Annotated[
        int | None,
        typer.Option(
            min=0,
            help="Refits to observers drawn again. By default 1000 if they are quick: "
            "if ws, wt, beta, scales and lapse alone are fitted.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1)] = 0,
    profile: Annotated[
        str, typer.Option(help="Constants to find the likelihood interval of.")
    ] = "",
    cross_validate: Annotated[
        str,
        typer.Option(
            help="Columns of the conditions (texture, block, velocity_deg_s, data_set) "
            "whose values are left out in turn."
        ),
    ] = "",
) -> None:
    """Fit the model's constants to votes, with standard errors and intervals.

    Writes fit.json, which camojab predict --parameters reads, fit.csv, every condition
    measured and predicted, and report.html.
    """
    if bootstrap == 1:
        raise typer.BadParameter("must be 0 or >= 2.", param_hint="'--bootstrap'")
    if data is None and votes is None:
        raise typer.BadParameter("give one of the two.", param_hint="--votes or --data")
    own = _own_study(data, votes, conditions, textures, encoding)
    with bits("64"), stages() as progress:
        from ._fit_command import Choice, fit_constants

        fit_constants(
            own=own,
            data=data or "",
            choice=Choice(
                to=to,
                free=_names(free),
                formulation=formulation,
                solver=solver,
                start=parameters,
                resamples=bootstrap,
                seed=seed,
                profiles=_names(profile),
                cross=_names(cross_validate),
            ),
            output=output,
            progress=progress,
        )


@app.command()
def bench(
    output: Folder,
    seconds: Annotated[
        float,
        typer.Option(
            min=0,
            help="Time after which no further batch size is begun. Errors, and one "
            "batch size of everything, are measured whatever it takes.",
        ),
    ] = 150,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1)] = 0,
) -> None:
    """Measure what accuracy costs on this machine.

    Writes bench.json, bench.csv and bench.png: error against throughput of every
    fidelity in both precisions and formulations, compiling, pooling and running
    apart, on the conditions that the authors' program was run on and the textures
    of Jindal et al. 2021, or built-in ones where these cannot be had.
    """
    # Both precisions are measured; each is entered where it is.
    with stages() as progress:
        from ._bench_command import bench

        bench(seconds=seconds, seed=seed, output=output, progress=progress)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _own_study(
    data: str | None,
    votes: Path | None,
    conditions: Path | None,
    textures: Path | None,
    encoding: str | None,
) -> Study | None:
    """The files of one's own experiment, if they are all there, or none are."""
    if votes is not None and conditions is not None:
        if data is not None:
            raise typer.BadParameter("does not go with --votes.", param_hint="'--data'")
        return Study(votes, conditions, textures, encoding)
    for name, given in (
        ("--votes", votes),
        ("--conditions", conditions),
        ("--textures", textures),
        ("--encoding", encoding),
    ):
        if given is not None:
            raise typer.BadParameter(
                "goes with --votes and --conditions.", param_hint=f"'{name}'"
            )
    return None
