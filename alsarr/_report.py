"""One page that shows what a run did, readable without a network."""

import base64
import html
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from camojab._files import write_text

from ._inputs import Inputs
from ._stages import Result


if TYPE_CHECKING:
    from matplotlib.figure import Figure


_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto;
       padding: 0 1rem; color: #222; background: #fff; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; } td, th { padding: .2rem .8rem; text-align: left;
       border-bottom: 1px solid #ddd; } td.n { text-align: right;
       font-variant-numeric: tabular-nums; }
img { max-width: 100%; } code { background: #f4f4f4; padding: .2rem .4rem;
       display: block; overflow-wrap: anywhere; }
p.simulated { background: #fff3cd; padding: .4rem .8rem; }
"""


def write_report(
    out: Path, inputs: Inputs, found: Result, made: Result, solved: Result, quote: str
) -> Result:
    """Write `report.html` into the folder `out`, pictures included in the page."""
    from camojab.plotting import quality_by_refresh_rate, quality_by_shading_rate

    from .plotting import frame_buffers

    table = inputs.observations.table
    predicted = np.asarray(found["predicted_jnd"])
    by_shading = quality_by_shading_rate(table, predicted)
    by_refresh = quality_by_refresh_rate(table, predicted)
    sections = [
        _note(inputs),
        _section("Fit to the votes", _fit_table(inputs, found)),
        _picture("Quality against shading rate", _png(by_shading)),
        _picture("Quality against refresh rate", _png(by_refresh)),
        _section("Tables", _tables_text(made)),
        _picture("The frame", _png(frame_buffers(inputs.frame))),
        _section("Shading rates", _rates_table(solved)),
        _picture("Rate map", (out / "rates.png").read_bytes()),
        _section("To quote", f"<code>{html.escape(quote)}</code>"),
    ]
    title = f"Shading rates for {html.escape(inputs.name)}"
    page = (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        f"<title>{title}</title><style>{_STYLE}</style></head><body>"
        f"<h1>{title}</h1>{''.join(sections)}</body></html>\n"
    )
    write_text(out / "report.html", page)
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


def _note(inputs: Inputs) -> str:
    if inputs.published:
        return ""
    return (
        "<p class='simulated'>The votes behind this page were <b>simulated</b> from "
        "the published constants; no person took part. The frame is drawn.</p>"
    )


def _fit_table(inputs: Inputs, found: Result) -> str:
    head = "<tr><th>block</th><th>RMSE [JND]</th><th>printed</th><th></th></tr>"
    rows = "".join(
        f"<tr><td>{html.escape(block)}</td><td class='n'>{value}</td>"
        f"<td class='n'>{printed}</td><td>{verdict}</td></tr>"
        for block, value, printed, verdict in fit_rows(inputs, found)
    )
    constants = ", ".join(f"{k} = {v:.6g}" for k, v in found["parameters"].items())
    scales = ", ".join(f"{k} = {v:.6g}" for k, v in found["scales"].items())
    verdict = html.escape(found["verdict"]) or "tolerance met"
    return (
        f"<table>{head}{rows}</table><p>Constants in the scale of the first data set: "
        f"{constants}. Scales of the others: {scales}. Levenberg-Marquardt, "
        f"{found['steps']} steps, {verdict}.</p>"
    )


def _tables_text(made: Result) -> str:
    return (
        f"<p>Eq. 31 for {len(made['textures'])} textures "
        f"({html.escape(', '.join(made['textures']))}), mip levels "
        f"{made['mip_levels'][0]} to {made['mip_levels'][-1]}, seven rates and two "
        "directions of motion, relative to 4x4. Error against the model on the sampled "
        f"conditions: largest {made['largest_error_jnd']:.3g} JND, median "
        f"{made['median_error_jnd']:.3g} JND.</p>"
    )


def _rates_table(solved: Result) -> str:
    rows = "".join(
        f"<tr><td>{name}</td><td class='n'>{share:.1%}</td></tr>"
        for name, share in solved["shares"].items()
    )
    return (
        f"<p>Greedy choice (Algorithm 1) at {solved['budget']:.2%} of full cost: "
        f"{solved['quality_jnd']:.2f} JND over {solved['tiles']} tiles for "
        f"{solved['cost']:.0f} of {solved['full_cost']} pixels; {solved['outside']} "
        "tiles lie outside the conditions that the tables were fitted to.</p>"
        f"<table><tr><th>rate</th><th>tiles</th></tr>{rows}</table>"
    )


def _section(title: str, body: str) -> str:
    return f"<h2>{title}</h2>{body}"


def _picture(title: str, png: bytes) -> str:
    data = base64.b64encode(png).decode("ascii")
    return _section(title, f"<img alt='{title}' src='data:image/png;base64,{data}'>")


def _png(figure: "Figure") -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()
