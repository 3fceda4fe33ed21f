"""One page that shows what a run did, readable without a network."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from camojab import Parameters
from camojab._files import write_text
from camojab._page import Html, page, picture, table, text

from ._inputs import Inputs
from ._stages import Result


if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


_MADE_UP = "They follow from the published constants. The frame is drawn."


def write_report(
    out: Path, inputs: Inputs, found: Result, made: Result, solved: Result, quote: str
) -> Result:
    """Write `report.html` into the folder `out`, pictures included in the page."""
    from camojab.plotting import quality_by_refresh_rate, quality_by_shading_rate

    from .plotting import frame_buffers

    measured = inputs.observations.table
    predicted = np.asarray(found["predicted_jnd"])
    by_shading = quality_by_shading_rate(measured, predicted)
    by_refresh = quality_by_refresh_rate(measured, predicted)
    buffers = frame_buffers(inputs.frame)
    rates = (out / "rates.png").read_bytes()
    sections = [
        ("Fit to the votes", [_fit_table(inputs, found), _fit_text(found)]),
        _picture("Quality against shading rate", by_shading),
        _picture("Quality against refresh rate", by_refresh),
        ("Tables", [_tables_text(made)]),
        _picture("The frame", buffers),
        ("Shading rates", [_rates_text(solved), _rates_table(solved)]),
        _picture("Rate map", rates),
    ]
    title = f"Shading rates for {inputs.name}"
    made_up = "" if inputs.published else _MADE_UP
    whole = page(title, sections, quote=quote, simulated=made_up)
    write_text(out / "report.html", whole)
    return {"sections": len(sections)}


def agreement(value: float, printed: str) -> str:
    """How a value stands to one that was printed with a few digits."""
    digits = len(printed.partition(".")[2])
    if f"{value:.{digits}f}" == printed:
        return "rounds to it"
    if np.floor(value * 10**digits) == round(float(printed) * 10**digits):
        return f"truncates to it (rounds to {value:.{digits}f})"
    return f"differs by {value - float(printed):+.{digits + 1}f}"


def fit_rows(inputs: Inputs, found: Result) -> list[tuple[str, str, str, str]]:
    """Block, root mean square error [JND], the printed one, and how they agree."""
    rows = []
    for block, value in found["rmse_jnd"].items():
        printed = inputs.published.get(block, "")
        verdict = agreement(value, printed) if printed else ""
        rows.append((block, f"{value:.3f}", printed, verdict))
    return rows


def _fit_table(inputs: Inputs, found: Result) -> Html:
    columns = ["block", "RMSE [JND]", "printed", ""]
    return table(_frame(fit_rows(inputs, found), columns))


def _fit_text(found: Result) -> Html:
    constants = Parameters(**found["parameters"]).report()
    scales = ", ".join(f"{k} = {v:.6g}" for k, v in found["scales"].items())
    return text(
        f"Constants in the scale of the first data set: {constants}. Scales of the "
        f"others: {scales}. Levenberg-Marquardt {found['verdict']}."
    )


def _tables_text(made: Result) -> Html:
    return text(
        f"Polynomials ({made['basis']}) for {len(made['textures'])} textures "
        f"({', '.join(made['textures'])}), mip levels {made['mip_levels'][0]:g} to "
        f"{made['mip_levels'][-1]:g} where they occur ({made['pairs']} pairs), 7 "
        "rates, two directions of motion, relative to 4x4. Error against the "
        "model under held-out conditions: largest "
        f"{made['largest_error_jnd']:.3g} JND, median "
        f"{made['median_error_jnd']:.3g} JND."
    )


def _rates_text(solved: Result) -> Html:
    return text(
        f"Chosen by the solver {solved['solver']} at {solved['budget']:.2%} of full "
        f"cost: {solved['quality_jnd']:.2f} JND over {solved['tiles']} tiles for "
        f"{solved['cost']:.0f} of {solved['full_cost']} pixels, at most "
        f"{solved['gap_jnd']:.3g} JND below the best map; {solved['outside']} "
        "tiles lie outside the conditions that the tables were fitted to."
    )


def _rates_table(solved: Result) -> Html:
    rows = [(name, f"{share:.1%}") for name, share in solved["shares"].items()]
    return table(_frame(rows, ["rate", "tiles"]))


def _frame(rows: list[tuple[str, ...]], columns: list[str]) -> "pandas.DataFrame":
    import pandas

    return pandas.DataFrame(rows, columns=columns)


def _picture(heading: str, source: "Figure | bytes") -> tuple[str, list[Html]]:
    return heading, [picture(source, heading)]
