"""`alsarr compare`: ways of choosing rates on the same frames, judged alike."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TYPE_CHECKING

import typer

from camojab import _command as command
from camojab.cli import Encoding


if TYPE_CHECKING:
    import numpy as np
    import pandas

    from camojab import Spectrum

    from ._comparison import Judged, Setting
    from ._frame import Frame


FILES = ("comparison.csv", "comparison.png")

_SNAPSHOT = "jindal2021/ALSaRR/sample_data/scene_snapshot.png"

# What the motion of the frame of Jindal et al. 2021 was rendered at.
_CAPTURED_HZ = 60.0

_FORMATS = {"refresh_rate_hz": ".4g", "cost_share": ".2%", "gap_jnd": ".1e"}

# What the library calls the options.
_OPTIONS = {
    "`texture`": "`--image`",
    "`encoding`": "`--encoding`",
    "`ppd`": "`--ppd`",
    "`persistence`": "`--persistence`",
    "`refresh_rates`": "`--refresh-rates`",
    "`refresh_rate`": "`--refresh-rate`",
    "`budgets`": "`--budgets`",
    "`picture`": "`--image`",
    "`luminance`": "`--luminance`",
}


def compare(
    data: Annotated[
        Literal["builtin", "jindal2021"] | None,
        typer.Option(
            help="A drawn frame with built-in textures, or the SciFi frame of Jindal "
            "et al. 2021. builtin, unless there is a --frame."
        ),
    ] = None,
    frame: Annotated[
        list[Path] | None,
        typer.Option(
            help="NPZ file of a frame (texture, mip_level, velocity_x, velocity_y, "
            "luminance, and previous_image for NAS and FidelityFX). May be given "
            "several times."
        ),
    ] = None,
    tables: Annotated[
        Path | None,
        typer.Option(
            help="Tables of the textures of --frame, .json or .npz. They judge."
        ),
    ] = None,
    budgets: Annotated[
        str,
        typer.Option(
            help="Shares of full rate everywhere at the highest refresh rate, from "
            "0.0625 to 1, with commas between."
        ),
    ] = "0.0625,0.125,0.25,0.5,1",
    refresh_rate: Annotated[
        float, typer.Option(help="Refresh rate of the methods that choose none [Hz].")
    ] = 60.0,
    refresh_rates: Annotated[
        str | None,
        typer.Option(
            help="Refresh rates to choose from in Hz: every one of LOW-HIGH or "
            "LOW-HIGH:STEP, or a list with commas between. --refresh-rate alone, if "
            "not given."
        ),
    ] = None,
    ppd: Annotated[
        float, typer.Option(help="Pixels per degree of the display.")
    ] = 60.0,
    persistence: Annotated[
        float, typer.Option(help="Share of a frame that the display is lit, in (0, 1].")
    ] = 1.0,
    luminance: Annotated[
        float,
        typer.Option(
            help="Luminance of the SciFi frame in cd/m^2; its own was not published."
        ),
    ] = 50.0,
    image: Annotated[
        str | None,
        typer.Option(
            help="Picture that stands for what moves, where there are --refresh-rates: "
            "a file, builtin:NAME or jindal2021:NAME. Its top left 512 x 512 pixels. "
            "The built-in frame has one of its own, and so has the SciFi frame."
        ),
    ] = None,
    encoding: Encoding = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder to write into.")
    ] = Path("compare"),
) -> None:
    """Compare ALSaRR, single rates, NAS, FidelityFX and MARRR at several budgets.

    Prints a table for each budget, and writes comparison.csv and comparison.png.
    """
    from camojab._results import check_folder

    check_folder(output, FILES)
    with command.usable(_OPTIONS), command.stages() as progress:
        from camojab._table_command import check_encoding

        from . import _comparison as job
        from ._refresh_command import _numbers, _spectrum

        check_encoding(encoding)
        shares = _numbers("--budgets", budgets)
        job.check_budgets(shares)
        choice = _numbers("--refresh-rates", refresh_rates) if refresh_rates else []
        display: dict[str, Any] = {"ppd": ppd, "persistence": persistence}
        display["refresh_rate"] = refresh_rate
        job.check_display(display, choice, luminance)
        _check_sources(data, frame, tables)
        picture = _spectrum(image, encoding) if image else None
        drawn = picture is None and not {*choice} <= {refresh_rate}
        progress("data", 0, 1)
        if frame and tables:
            name, why, given = _own(frame, tables)
        elif data == "jindal2021":
            name, why, given = _jindal2021(ppd, luminance, drawn)
        else:
            steps = lambda *done: progress("tables", *done)
            highest = max(choice, default=refresh_rate)
            name, why, given = _builtin(ppd, persistence, highest, drawn, steps)
        if picture is not None:
            given["picture"] = picture
        setting = job.Setting(**given, **display, refresh_rates=choice)
        notes = _notes(setting, why)
        progress("data", 1, 1)
        steps = lambda *done: progress("methods", *done)
        rows = job.compare(setting, shares, progress=steps)
        _write(output, rows)
    _print(rows, setting.highest)
    for note in notes:
        print(note)
    line = f"{ppd:g} px/deg, {setting.luminance:.4g} cd/m^2, persistence "
    line += f"{persistence:g}, {refresh_rate:g} Hz"
    line += f" or chosen from {refresh_rates} Hz" if choice else ""
    print(f"to quote: alsarr {command.release()}, {name}, {line}")
    print(f"written: {', '.join(str(output / file) for file in FILES)}")


def _check_sources(
    data: str | None, frame: list[Path] | None, tables: Path | None
) -> None:
    if bool(frame) != bool(tables):
        given = "`--frame`" if frame else "`--tables`"
        raise ValueError(
            f"`--frame` and `--tables` must be given together, got {given} alone."
        )
    if data and frame:
        raise ValueError(f"`--data` must be left out with --frame, got {data}.")


def _own(frames: list[Path], tables: Path) -> tuple[str, str, dict[str, Any]]:
    """What it is called, why a picture is missing, and parts of the setting."""
    from ._frame import load_frame
    from .oracle import TableOracle
    from .tables import load_tables

    judge = TableOracle(load_tables(tables))
    given = {"frames": [load_frame(path) for path in frames], "judge": judge}
    name = f"{len(frames)} frame{'s' if len(frames) > 1 else ''} with {tables}"
    return name, "not every file has previous_image", given


def _jindal2021(
    ppd: float, luminance: float, drawn: bool
) -> tuple[str, str, dict[str, Any]]:
    from ._inputs import jindal2021_inputs
    from .oracle import TableOracle

    inputs = jindal2021_inputs(
        ppd=ppd, refresh_rate=_CAPTURED_HZ, frame_luminance=luminance
    )
    if inputs.tables is None:
        raise ValueError("`tables` must be those of the frame's materials, got None.")
    given = {"frames": [inputs.frame], "judge": TableOracle(inputs.tables)}
    if drawn:
        given["picture"] = _snapshot()
    name = "SciFi frame of Jindal et al. 2021"
    return name, "that of the SciFi frame was never published", given


def _snapshot() -> "Spectrum":
    """A view of the scene, which its authors' program takes too."""
    import imageio.v3

    from camojab import datasets, luminance, Spectrum

    pixels = imageio.v3.imread(datasets.fetch(_SNAPSHOT))
    return Spectrum.from_texture(luminance(pixels, encoding="sRGB"))


def _builtin(
    ppd: float,
    persistence: float,
    highest: float,
    drawn: bool,
    progress: Callable[[int, int], None],
) -> tuple[str, str, dict[str, Any]]:
    """The drawn frame with a picture before it, its tables, and the model itself."""
    from camojab import luminance, Spectrum

    from ._frame._procedural import procedural_picture
    from ._inputs import builtin_inputs
    from .oracle import CamojabOracle, TableOracle
    from .tables import distil, Eq31LogTravel, Form, sample

    inputs = builtin_inputs(ppd=ppd, refresh_rate=highest)
    textures = list(inputs.textures.values())
    # Half the peak is the brightest tile's mean, so hardly a texel is cut off.
    peak = 2 * float(inputs.frame.luminance.max())
    image = procedural_picture(inputs.frame, textures, peak_luminance=peak)
    frame = _with_image(inputs.frame, image)
    spectra = {k: Spectrum.from_texture(v) for k, v in inputs.textures.items()}
    display: dict[str, Any] = {"ppd": ppd, "persistence": persistence}
    samples = sample(spectra, inputs.scene, progress=progress, **display)
    judge = TableOracle(distil(samples, Form(Eq31LogTravel())))
    model = CamojabOracle(spectra, pairs=inputs.scene.pairs, **display)
    given = {"frames": [frame], "judge": judge, "oracles": {"CaMoJAB": model}}
    if drawn:
        light = luminance(image, encoding="sRGB")
        top, left = (max(0, (side - 512) // 2) for side in light.shape)
        given["picture"] = Spectrum.from_texture(light[top:, left:])
    return "built-in frame", "", given


def _with_image(frame: "Frame", image: "np.ndarray") -> "Frame":
    from ._frame import Frame

    buffers = {name: getattr(frame, name) for name in Frame.UNITS}
    return Frame(**buffers, previous_image=image)


def _notes(setting: "Setting", why_no_image: str) -> list[str]:
    """What is missing, and what the judge has to guess."""
    notes = []
    if not setting.has_images:
        notes.append(
            "NAS and FidelityFX are left out: they look at the picture before the "
            f"frame, and {why_no_image}."
        )
    if not setting.is_small:
        notes.append(
            "The exact choice is left out: a dynamic programme over so many tiles "
            "takes minutes."
        )
    tiles = sum(frame.texture.size for frame in setting.frames)
    outside = [
        int(setting.judge.count_outside(frame, setting.refresh_rate))
        for frame in setting.frames
    ]
    if sum(outside):
        notes.append(
            f"{sum(outside)} of {tiles} tiles show textures or conditions that the "
            "tables were not made for, and are judged by the nearest."
        )
    return notes


def _table(rows: Sequence["Judged"]) -> "pandas.DataFrame":
    import pandas

    from ._rates import RATES

    names = ("method", "budget_share", "refresh_rate_hz", "quality_jnd", "loss_jnd")
    names += ("cost_share", "gap_jnd", *(f"share_{rate}" for rate in RATES.names))
    plain = [
        (r.method, r.budget, r.refresh_rate, r.quality, r.loss, r.cost, r.gap)
        for r in rows
    ]
    whole = [row + judged.shares for row, judged in zip(plain, rows, strict=True)]
    return pandas.DataFrame(whole, columns=list(names))


def _print(rows: Sequence["Judged"], highest: float) -> None:
    """A table for each budget, without what does not differ in any."""
    from ._rates import RATES

    formats = _FORMATS | dict.fromkeys(RATES.names, ".1%")
    dropped = ["budget_share"]
    if len({row.refresh_rate for row in rows}) == 1:
        dropped.append("refresh_rate_hz")
    if all(row.quality == -row.loss for row in rows):
        dropped.append("quality_jnd")
    for share in dict.fromkeys(row.budget for row in rows):
        part = _table([row for row in rows if row.budget == share])
        part = part.drop(columns=dropped)
        part.columns = [str(name).removeprefix("share_") for name in part.columns]
        title = f"Budget {100 * share:.4g} % of full rate at {highest:g} Hz"
        command.print_table(title, part, formats)


def _write(output: Path, rows: Sequence["Judged"]) -> None:
    from camojab._files import replacing, write_text
    from camojab._results import to_csv

    from .plotting import methods_compared

    write_text(output / FILES[0], to_csv(_table(rows)))
    with replacing(output / FILES[1]) as temporary:
        methods_compared(rows).savefig(temporary, format="png", dpi=150)
