"""Pages that open without a network: one HTML file, its pictures inside."""

import base64
import html
import io
from collections.abc import Mapping, Sequence
from typing import Any, NewType, TYPE_CHECKING


if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


# Mark-up in which whatever came from outside is escaped.
Html = NewType("Html", str)

# How the names of columns end, and the unit that says.
_UNITS = {
    "_jnd": "JND",
    "_deg_s": "deg/s",
    "_hz": "Hz",
    "_cd_m2": "cd/m2",
}

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto;
       padding: 0 1rem; color: #222; background: #fff; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
div.wide { overflow-x: auto; } table { border-collapse: collapse; }
td, th { padding: .2rem .8rem; text-align: left; border-bottom: 1px solid #ddd; }
td { white-space: nowrap; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; }
img { max-width: 100%; } code { background: #f4f4f4; padding: .2rem .4rem;
       display: block; overflow-wrap: anywhere; }
p.simulated { background: #fff3cd; padding: .4rem .8rem; }
"""


def page(
    title: str,
    sections: Sequence[tuple[str, Sequence[Html]]],
    *,
    quote: str,
    simulated: str = "",
) -> str:
    """A whole page.

    **Arguments:**

    - `title`: of the page, as plain text, like everything here that is not `Html`.
    - `sections`: headings with what stands below them.
    - `quote`: the line to quote, with versions, beside any number of the page.
    - `simulated`: for data that are not people's, a sentence to add to the note that
        says so; without it there is no note.
    """
    note = ""
    if simulated:
        note = (
            "<p class='simulated'>The votes behind this page were <b>simulated</b>; "
            f"no person took part. {html.escape(simulated)}</p>"
        )
    quoted = Html(f"<code>{html.escape(quote)}</code>")
    body = "".join(
        f"<h2>{html.escape(heading)}</h2>{''.join(parts)}"
        for heading, parts in [*sections, ("To quote", [quoted])]
    )
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width'>"
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>"
        f"<h1>{html.escape(title)}</h1>{note}{body}</body></html>\n"
    )


def text(words: str) -> Html:
    """A paragraph."""
    return Html(f"<p>{html.escape(words)}</p>")


def table(frame: "pandas.DataFrame", formats: Mapping[str, str] | None = None) -> Html:
    """A table without its index; columns of numbers are aligned to the right.

    `formats` is as in `cells`.
    """
    columns = cells(frame, formats)
    kinds = [" class='n'" if numeric(column) else "" for column in columns.values()]
    line = lambda tag, row: "".join(
        f"<{tag}{kind}>{html.escape(cell)}</{tag}>"
        for kind, cell in zip(kinds, row, strict=True)
    )
    rows = "".join(
        f"<tr>{line('td', row)}</tr>" for row in zip(*columns.values(), strict=True)
    )
    head = f"<tr>{line('th', columns)}</tr>"
    return Html(f"<div class='wide'><table>{head}{rows}</table></div>")


def picture(source: "Figure | bytes", alt: str) -> Html:
    """A figure, or the bytes of a PNG file; `alt` says in words what it shows."""
    data = base64.b64encode(source if isinstance(source, bytes) else png(source))
    return Html(
        f"<img alt='{html.escape(alt)}' "
        f"src='data:image/png;base64,{data.decode('ascii')}'>"
    )


def png(figure: "Figure") -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def cells(
    frame: "pandas.DataFrame", formats: Mapping[str, str] | None = None
) -> dict[str, list[str]]:
    """The columns as people read them, by their headings.

    Units stand in brackets, floats have three decimals, and NaN is left empty.
    `formats` gives columns of floats, by their names, other formats, such as `".2g"`.
    """
    formats = formats or {}
    return {
        _heading(str(name)): [
            _cell(value, formats.get(str(name), ".3f")) for value in column
        ]
        for name, column in frame.items()
    }


def _heading(name: str) -> str:
    for end, unit in _UNITS.items():
        if name.endswith(end):
            name = f"{name.removesuffix(end)} [{unit}]"
    return name.replace("_", " ")


def _cell(value: Any, form: str) -> str:
    if not isinstance(value, float):
        return "" if value is None else str(value)
    if value != value:
        return ""
    shown = format(value, form)
    # A small negative number is not "-0.000".
    return shown if shown.strip("-0.") else shown.removeprefix("-")


def numeric(column: Sequence[str]) -> bool:
    """Whether all that stands in a column is numbers, and something does."""
    filled = [cell for cell in column if cell]
    return bool(filled) and all(map(_is_number, filled))


def _is_number(cell: str) -> bool:
    try:
        float(cell.removesuffix("%"))
    except ValueError:
        return False
    return True
