import json
from pathlib import Path
from typing import Any

import numpy as np

from camojab._files import write_text

from .._rates import RATES
from ._tables import Domain, QualityTables


_VARIABLES = {
    "velocity": ("v", "deg/s"),
    "refresh_rate": ("f", "Hz"),
    "log10_luminance": ("L", "log10(cd/m^2)"),
}
SCHEMA = "alsarr-tables/2"

# What a reader must find exactly, because the numbers mean nothing else.
_FIXED = {
    "schema": SCHEMA,
    "quantity": "quality",
    "unit": "JND",
    "basis": "eq31",
    "axes": ["texture", "mip_level", "rate", "direction", "coefficient"],
    "rates": list(RATES.names),
    "directions": ["x", "y"],
}
_EXPLAINED = {
    "formula": "q = (W0 + W1*v + W2*f + W3*v^2 + W4*v*f + W5*f^2)"
    " * (W6*L^3 + W7*L^2 + W8*L + W9)",
    "use": "clamp v, f and L to their domain and take the nearest mip level;"
    " direction x with the velocity in x, y with that in y; mean of both",
}


def save_tables(path: str | Path, tables: QualityTables) -> None:
    """Write tables as JSON that an engine can read without this package.

    Coefficients are rounded to float32 and written with nine significant digits, which
    hold every float32 exactly: whoever reads them computes with the same bits. The file
    names its schema, units, basis, domain, textures, mip levels, errors and model. It
    is written whole or not at all.

    **Raises:** `ValueError` for a coefficient or error that is not finite in float32.
    """
    single = np.asarray(tables.coefficients, np.float32)
    errors = np.asarray([tables.largest_error, tables.median_error], np.float32)
    if not (np.isfinite(single).all() and np.isfinite(errors).all()):
        raise ValueError("`tables` must hold numbers that are finite in float32.")
    header = _FIXED | {"relative_to": tables.relative_to} | _EXPLAINED
    header["variables"] = {
        name: {
            "symbol": symbol,
            "unit": unit,
            "domain": np.asarray(getattr(tables.domain, name), float).tolist(),
        }
        for name, (symbol, unit) in _VARIABLES.items()
    }
    header["textures"] = list(tables.texture_names)
    header["mip_levels"] = np.asarray(tables.mip_levels, float).tolist()
    header["largest_error_jnd"], header["median_error_jnd"] = _nine_digits(errors)
    header["model"] = tables.model
    head = json.dumps(header, indent=1, allow_nan=False).removesuffix("\n}")
    rows = ",\n".join(json.dumps(_nine_digits(texture)) for texture in single)
    write_text(path, f'{head},\n "coefficients": [\n{rows}\n ]\n}}\n')


def load_tables(path: str | Path) -> QualityTables:
    """Read tables that `save_tables` wrote.

    **Raises:** `ValueError` naming the file and what is wrong with it: no JSON, another
    schema, a missing entry, rates in another order, a shape that does not fit the
    textures and mip levels, a number that is not finite, or an empty domain.
    `FileNotFoundError` if there is none.
    """
    document = _read(path)
    variables = _entry(document, "variables", dict, path)
    domain = {}
    for name in _VARIABLES:
        variable = _entry(variables, name, dict, path)
        domain[name] = _numbers(variable, "domain", (2,), path)
        if domain[name][0] > domain[name][1]:
            raise ValueError(
                f"{path}: the domain of {name} must rise, got {domain[name].tolist()}."
            )
    textures = _entry(document, "textures", list, path)
    mips = _entry(document, "mip_levels", list, path)
    shape = (len(textures), len(mips), len(RATES), 2, 10)
    coefficients = _numbers(document, "coefficients", shape, path)
    try:
        return QualityTables(
            coefficients=coefficients.astype(np.float32),
            mip_levels=tuple(_numbers(document, "mip_levels", (len(mips),), path)),
            domain=Domain(**domain),
            largest_error=_numbers(document, "largest_error_jnd", (), path),
            median_error=_numbers(document, "median_error_jnd", (), path),
            texture_names=tuple(map(str, textures)),
            model=_entry(document, "model", str, path),
            relative_to=_rate(document, path),
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _nine_digits(x: np.ndarray | np.floating) -> Any:
    if isinstance(x, np.floating):
        return float(f"{x:.9g}")
    return [_nine_digits(part) for part in x]


def _read(path: str | Path) -> dict[str, Any]:
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: is no JSON: {error}.") from error
    if not isinstance(document, dict):
        raise ValueError(f"{path}: must hold one JSON object.")
    for name, value in _FIXED.items():
        if document.get(name) != value:
            raise ValueError(
                f"{path}: `{name}` must be {value!r}, got {document.get(name)!r}."
            )
    return document


def _entry(document: dict[str, Any], name: str, kind: type, path: str | Path) -> Any:
    if not isinstance(document.get(name), kind):
        raise ValueError(f"{path}: `{name}` must be there and be a {kind.__name__}.")
    return document[name]


def _rate(document: dict[str, Any], path: str | Path) -> str | None:
    name = document.get("relative_to", "")
    if name not in (*RATES.names, None):
        raise ValueError(
            f"{path}: `relative_to` must be one of {', '.join(RATES.names)} or null, "
            f"got {name!r}."
        )
    return name


def _numbers(
    document: dict[str, Any], name: str, shape: tuple[int, ...], path: str | Path
) -> np.ndarray:
    try:
        numbers = np.array(document.get(name), np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{path}: `{name}` must be numbers of shape {shape}."
        ) from error
    if numbers.shape != shape:
        raise ValueError(
            f"{path}: `{name}` must have shape {shape}, got {numbers.shape}."
        )
    if not np.isfinite(numbers).all():
        raise ValueError(f"{path}: `{name}` must be finite.")
    return numbers
