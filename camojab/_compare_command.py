"""`camojab compare`: CaMoJAB, MARRR and NAS on the same measurements."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TYPE_CHECKING

import numpy as np

from . import comparison, datasets, fit
from ._command import print_table, Study, usable
from ._display import LowPass
from ._page import Html, page, picture, table, text
from ._parameters import load_parameters
from ._results import (
    check_folder,
    JINDAL2021,
    OPINIONS,
    provenance,
    quote,
    read_study,
    records,
    save,
    simulated_note,
    study_files,
    to_csv,
    to_json,
)
from ._shipped import shipped
from .comparison._table import ALONG, BLOCKS, TRACKED


if TYPE_CHECKING:
    import pandas


FILES = ("compare.json", "compare.csv", "report.html")

_SETTINGS = (
    "As in the paper: each model has its published constants, and a slope through the "
    "origin is fitted to JND (one for the three blocks of Experiment 1, one for each "
    "experiment of Denes et al. 2020), a slope and an intercept to opinion scores. For "
    "the blocks and for ITU-R PPD MARRR, but not CaMoJAB, is told that the resolution "
    "was reduced along both axes.",
    "Fair: every model is told what was shown, coarse pixels along the motion only in "
    "the blocks of Experiment 1 and along both axes in ITU-R PPD, and has a slope of "
    "its own for each block.",
    "The constants of CaMoJAB were fitted to the first five columns and those of MARRR "
    "to the fourth and fifth: only the others are predictions. The error of a texture "
    "behind NAS in the paper is not known; here it is that of "
    "camojab.baselines.texture_error_yang2019.",
)
_PARTS = {"vrs": "coarse shading", "eye_blur": "eye blur", "judder": "judder"}


def compare(
    *,
    own: Study | None,
    parameters: Path | None,
    output: Path,
    progress: Callable[[str, int, int], None],
) -> None:
    """Compare, write the files of `FILES` into the folder, and print the tables."""
    check_folder(output, FILES)
    with usable():
        constants, formulation = load_parameters(
            parameters or shipped("parameters_released.json")
        )
        if own:
            read = read_study(own)
            observations, name = fit.scaled(read), str(own.votes)
            files = study_files(own, read.textures)
        else:
            observations, name = None, "jindal2021, Mackin et al. 2016, ITU-R BT.2246"
            files = {
                **{each: datasets.fetch(each) for each in JINDAL2021},
                **{each: shipped(each) for each in OPINIONS},
            }
    if parameters:
        files[str(parameters)] = parameters
    compared = comparison.compare(
        observations,
        parameters=constants,
        formulation=formulation,
        progress=lambda *steps: progress("models", *steps),
    )
    parts, notes = _ablation(
        observations, formulation, lambda *steps: progress("without parts", *steps)
    )
    main = _own_table(compared) if own else comparison.table5(compared).reset_index()
    notes = [*([] if own else [_marrr(compared), *_SETTINGS]), *notes]
    line = quote(name, f"parameters: {formulation.value}, {constants.report()}")
    document = {
        **provenance("camojab-compare/1", files),
        "data": name,
        "formulation": formulation.value,
        "parameters": {key: float(value) for key, value in vars(constants).items()},
        "comparison": records(compared),
        "table": records(main),
        "ablation": records(parts),
        "notes": notes,
    }
    sections = _sections(compared, main, parts, notes, own is not None)
    title = f"CaMoJAB, MARRR and NAS on {name}"
    made_up = simulated_note(own.votes) if own else ""
    whole = page(title, sections, quote=line, simulated=made_up)
    contents = (to_json(document), to_csv(compared), whole)
    save(output, dict(zip(FILES, contents, strict=True)))
    heading = f"RMSE [JND] on {name}" if own else _TABLE_5
    print_table(heading, main)
    if not own:
        print_table(_CONSTANTS, _constants(compared))
    if len(parts):
        print_table(_ABLATION, _by_parts(parts))
    for note in notes:
        print(note)
    print(f"to quote: {line}")
    print(f"written: {', '.join(str(output / each) for each in FILES)}")


_TABLE_5 = "Table 5 of Jindal et al. 2021: RMSE [JND; last three: points of the score]"
_CONSTANTS = (
    "RMSE [JND] by what is fitted: a slope or also an intercept, shared by the three "
    "blocks or one each (velocities as tracked, resolution reduced along the motion)"
)
_ABLATION = (
    "RMSE [JND] of CaMoJAB refitted with some of its parts (exponent, weights and "
    "scales free)"
)


def _ablation(
    observations: fit.Observations | None,
    formulation: Any,
    progress: Callable[[int, int], None],
) -> tuple["pandas.DataFrame", list[str]]:
    """The table, or none and the reason, which is that there are too few values."""
    import pandas as pd

    try:
        found = comparison.ablation(
            observations, formulation=formulation, progress=progress
        )
    except ValueError as error:
        return pd.DataFrame(), [f"No refit without parts: {error}"]
    return found, []


def _wide(rows: Any, index: list[str]) -> "pandas.DataFrame":
    """A column for each block, in the order of the rows."""
    wide = rows.pivot(index=index, columns="block", values="rmse")
    wide = wide[list(dict.fromkeys(rows["block"]))].reset_index()
    wide.columns.name = None
    order = rows[index].drop_duplicates()
    return order.merge(wide, on=index, how="left")


def _own_table(compared: Any) -> "pandas.DataFrame":
    return _wide(compared, ["model", "sharing", "constants"])


def _constants(compared: Any) -> "pandas.DataFrame":
    """The blocks of Experiment 1 in each way of fitting constants."""
    rows = compared[
        compared["block"].isin(BLOCKS[:3])
        & (compared["velocity"] == TRACKED)
        & (compared["reduction"] == ALONG)
    ]
    return _wide(rows, ["model", "sharing", "constants"])


def _by_parts(found: Any) -> "pandas.DataFrame":
    """A line for each set of parts, a column for each block."""
    kinds = list(_PARTS)
    names = [
        " + ".join(
            _PARTS[kind] for kind, there in zip(kinds, row, strict=True) if there
        )
        for row in found[kinds].itertuples(index=False, name=None)
    ]
    lorentzian = LowPass.LORENTZIAN.value
    names = [
        name if shape == lorentzian else f"{name}, {shape} for Lorentzian"
        for name, shape in zip(names, found["low_pass"], strict=True)
    ]
    rows = found.assign(parts=names, rmse=found["rmse_jnd"])
    wide = _wide(rows, ["parts"])
    once = rows.drop_duplicates("parts")
    return wide.assign(
        beta=once["beta"].to_numpy(),
        temporal_share=once["temporal_share"].to_numpy(),
        search=np.where(once["verdict"] == "", "done", "tolerance not met"),
    )


def _marrr(compared: Any) -> str:
    """The two results of MARRR for the blocks, and which of them is fair."""
    rows = compared[(compared["model"] == "MARRR") & compared["block"].isin(BLOCKS[:3])]
    shown = lambda chosen: " / ".join(f"{x:.3f}" for x in rows.loc[chosen, "rmse"])
    tracked = rows["velocity"] == TRACKED
    return (
        "MARRR on the blocks PC / Mobile / VR: as the paper has it (both axes coarse, "
        f"one slope for the three) {shown(rows['printed'].notna())} JND; with the "
        "resolution reduced as in the experiment (along the motion only) and a slope "
        f"for each {shown(rows['fair'] & tracked)} JND with the velocities as tracked, "
        f"{shown(rows['fair'] & ~tracked)} JND as shown. The latter is fair, because "
        "it is what the experiment showed and what CaMoJAB is told; Table 5 "
        "understates MARRR."
    )


def _sections(
    compared: Any, main: Any, parts: Any, notes: list[str], own: bool
) -> list[tuple[str, list[Html]]]:
    from .plotting import rmse_by_block

    said = [text(note) for note in notes]
    bars = picture(rmse_by_block(_drawn(compared)), "RMSE of each model and block")
    sections = [("RMSE by block and model", [bars, table(main), *said])]
    if not own:
        sections.append(
            ("What is fitted", [text(_CONSTANTS), table(_constants(compared))])
        )
    if len(parts):
        sections.append(("Without parts", [text(_ABLATION), table(_by_parts(parts))]))
    return [*sections, ("Every setting", [table(compared)])]


def _drawn(compared: Any) -> "pandas.DataFrame":
    """The bars: those of the paper's setting if there are any, and the fair ones."""
    import pandas as pd

    blocks = compared["block"].isin(BLOCKS[:3])
    paper = compared[compared["printed"].notna()]
    fair = compared[compared["fair"] & ~(blocks & (compared["velocity"] == "shown"))]
    return pd.concat(
        [
            paper.assign(setting="as in the paper"),
            fair.assign(setting="fair: what was shown, a slope for each block").assign(
                printed=float("nan")
            ),
        ],
        ignore_index=True,
    )
