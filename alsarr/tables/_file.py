"""Tables as files: JSON for everyone, NPZ where there are many of them."""

import hashlib
import io
import json
import zipfile
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from camojab._files import DAMAGED, replacing, write_text

from ._basis import basis_from
from ._certificate import Certificate
from ._domain import Conditions, Domain, domain_axes
from ._tables import index_entries, QualityTables


SCHEMA = "alsarr-tables/3"

# Larger files are not read: they are none of ours.
_MOST_BYTES = 2**30

_VARIABLES = {
    "velocity": ("v", "deg/s"),
    "refresh_rate": ("f", "Hz"),
    "log10_luminance": ("L", "log10(cd/m^2)"),
}
# What a reader must find exactly, because the numbers mean nothing else.
_FIXED = {"schema": SCHEMA, "quantity": "quality", "unit": "JND"}
_USE = (
    "clamp v, f and L to their domain and take the nearest of the texture's mip "
    "levels, the finer of two; direction x with the velocity in x, y with that in y, "
    "both with either; mean of both directions; a rate that is absent is the nearest "
    "finer one; "
    "rates 4, 2 and 1 are sides of the coarse pixel along the motion"
)
_ERRORS = ("largest_jnd", "percentile_99_jnd", "median_jnd")
_HEADER = {
    *_FIXED,
    *("basis", "formula", "use", "variables", "rates", "directions", "relative_to"),
    *("tolerance_jnd", "meets_tolerance", "textures", "mip_levels", "model"),
    *("version", "certificate", "entries", "sha256"),
}

_Arrays = dict[str, np.ndarray]


def save_tables(path: str | Path, tables: QualityTables) -> None:
    """Write tables as JSON or, where the name ends in .npz, as NumPy's arrays.

    Numbers are rounded to float32 and written with nine significant digits, which hold
    every float32 exactly: whoever reads them computes with the same bits. The file
    names its schema, units, basis, domain, textures, mip levels, certificate, model and
    version, and ends in a checksum. It is written whole or not at all. `schema()`
    describes the JSON.

    **Raises:** `ValueError` for another ending than .json and .npz, or a number that is
    not finite in float32.
    """
    header, arrays = _parts(tables)
    if not all(np.isfinite(x).all() for x in arrays.values()):
        raise ValueError("`tables` must hold numbers that are finite in float32.")
    if _kind(path) == ".json":
        write_text(path, _json(_sealed(_document(header, arrays))))
        return
    header = _sealed(header, *arrays.values())
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file, allow_pickle=False, header=np.array(json.dumps(header)), **arrays
        )


def load_tables(path: str | Path) -> QualityTables:
    """Read tables that `save_tables` wrote.

    **Raises:** `ValueError` naming the file and what is wrong with it: neither JSON nor
    NPZ, cut off, altered, of another schema or more than 1 GiB, a missing or unknown
    entry, a shape that does not fit the textures and mip levels, a number that is not
    finite, or an empty domain. `FileNotFoundError` if there is none.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ValueError(f"must have at most {_MOST_BYTES} bytes.")
        header, arrays = _read_json(path) if _kind(path) == ".json" else _read_npz(path)
        return _tables(header, arrays)
    # What is missing or of another kind is whatever the reader stumbles over.
    except (KeyError, TypeError, IndexError, AttributeError, OverflowError) as error:
        raise ValueError(f"{path}: lacks or has another kind of {error}.") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def schema() -> dict[str, Any]:
    """The JSON Schema of the JSON that `save_tables` writes."""
    text = files("alsarr.tables").joinpath("tables.schema.json").read_text("utf-8")
    return json.loads(text)


def _kind(path: str | Path) -> str:
    kind = Path(path).suffix.lower()
    if kind not in (".json", ".npz"):
        raise ValueError(f"`path` must end in .json or .npz, got {path}.")
    return kind


def _parts(tables: QualityTables) -> tuple[dict[str, Any], _Arrays]:
    """What is text and short, and what is many numbers."""
    axes = zip(_VARIABLES.items(), domain_axes(tables.domain), strict=True)
    one = tables.coefficients.shape[2] == 1
    certificate = tables.certificate
    overall = np.asarray(certificate.overall, np.float32)
    header = _FIXED | {
        "basis": tables.basis.describe(),
        "formula": tables.basis.formula(),
        "use": _USE,
        "variables": {
            name: {"symbol": symbol, "unit": unit, "domain": list(ends)}
            for (name, (symbol, unit)), ends in axes
        },
        "rates": list(tables.rates),
        "directions": ["both"] if one else ["x", "y"],
        "relative_to": tables.relative_to,
        "tolerance_jnd": tables.tolerance_jnd,
        "meets_tolerance": tables.meets,
        "textures": list(tables.texture_names),
        "mip_levels": np.asarray(tables.mip_levels, float).tolist(),
        "model": tables.model,
        "version": version("alsarr"),
        "certificate": dict(zip(_ERRORS, _nine_digits(overall), strict=True)),
        "entries": _owners(tables),
    }
    errors = (certificate.largest, certificate.percentile_99, certificate.median)
    arrays = {
        "coefficients": np.asarray(tables.coefficients, np.float32),
        "errors": np.stack([np.asarray(e, np.float32) for e in errors]),
        "sample": np.stack([np.asarray(x, np.float32) for x in certificate.sample]),
    }
    return header, arrays


def _owners(tables: QualityTables) -> list[dict[str, Any]]:
    """The texture and the mip levels that each entry was made for."""
    entry, occurs = np.asarray(tables.entry), np.asarray(tables.occurs)
    levels = np.asarray(tables.mip_levels, float)
    owners = []
    for i, constant in enumerate(np.asarray(tables.constant).tolist()):
        texture, own = np.nonzero((entry == i) & occurs)
        owner = {
            "texture": tables.texture_names[texture[0]],
            "mip_levels": levels[own].tolist(),
            "constant": constant,
        }
        owners.append(owner)
    return owners


def _document(header: dict[str, Any], arrays: _Arrays) -> dict[str, Any]:
    """All of it in one tree, the numbers of an entry beside its name."""
    entries = []
    for i, owner in enumerate(header["entries"]):
        rows = {"coefficients": _nine_digits(arrays["coefficients"][i])}
        if owner["constant"]:
            rows = {"value_jnd": rows["coefficients"][0][0][0]}
        errors = {
            n: _nine_digits(arrays["errors"][k, i]) for k, n in enumerate(_ERRORS)
        }
        entries.append(owner | errors | rows)
    sample = dict(zip(_VARIABLES, map(_nine_digits, arrays["sample"]), strict=True))
    certificate = header["certificate"] | {"sample": sample}
    return header | {"certificate": certificate, "entries": entries}


def _json(document: dict[str, Any]) -> str:
    """A line for every field and every entry."""
    line = lambda value: json.dumps(value, allow_nan=False)
    lines = [f"{line(k)}: {line(v)}" for k, v in document.items() if k != "entries"]
    entries = ",\n  ".join(map(line, document["entries"]))
    # The checksum comes last, after what it is of.
    lines.insert(-1, f'"entries": [\n  {entries}\n ]')
    return "{\n " + ",\n ".join(lines) + "\n}\n"


def _sealed(document: dict[str, Any], *arrays: np.ndarray) -> dict[str, Any]:
    """With the checksum of all the rest."""
    rest = {name: value for name, value in document.items() if name != "sha256"}
    text = json.dumps(rest, sort_keys=True, allow_nan=False)
    sha = hashlib.sha256(text.encode())
    for array in arrays:
        sha.update(np.ascontiguousarray(array, "<f4").tobytes())
    return rest | {"sha256": sha.hexdigest()}


def _nine_digits(x: np.ndarray | np.floating) -> Any:
    if isinstance(x, np.floating):
        return float(f"{x:.9g}")
    return [_nine_digits(part) for part in x]


def _read_json(path: Path) -> tuple[dict[str, Any], _Arrays]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"is no JSON: {error}.") from error
    _check(document)
    basis = basis_from(document["basis"])
    records = (len(document["rates"]), len(document["directions"]))
    coefficients, errors = [], []
    for entry in document["entries"]:
        if entry["constant"]:
            one = np.asarray(basis.constant(float(entry["value_jnd"])))
            coefficients.append(np.broadcast_to(one, (*records, one.size)))
        else:
            shape = (*records, basis.num_coefficients)
            coefficients.append(_numbers(entry["coefficients"], "coefficients", shape))
        errors.append([_numbers(entry[name], name, records) for name in _ERRORS])
    sample = document["certificate"]["sample"]
    arrays = {
        "coefficients": np.stack(coefficients).astype(np.float32),
        "errors": np.moveaxis(np.array(errors, np.float32), 1, 0),
        "sample": np.array(
            [_numbers(sample[n], n, None) for n in _VARIABLES], np.float32
        ),
    }
    return document, arrays


def _read_npz(path: Path) -> tuple[dict[str, Any], _Arrays]:
    # From memory, so that a bad offset is no error of the operating system.
    data = io.BytesIO(path.read_bytes())
    if not zipfile.is_zipfile(data):
        raise ValueError("is no NPZ file, or was cut off.")
    try:
        with zipfile.ZipFile(data) as archive:
            if sum(member.file_size for member in archive.infolist()) > _MOST_BYTES:
                raise ValueError(f"must unpack to at most {_MOST_BYTES} bytes.")
        data.seek(0)
        with np.load(data, allow_pickle=False) as stored:
            header = json.loads(str(stored["header"]))
            names = ("coefficients", "errors", "sample")
            arrays = {name: stored[name] for name in names}
    except ValueError:
        # It says itself what is wrong.
        raise
    except DAMAGED as error:
        raise ValueError(f"was altered or cut off: {error}.") from error
    _check(header, *arrays.values())
    return header, arrays


def _refuse(token: str) -> None:
    raise ValueError(f"{token} is no number")


def _check(document: Any, *arrays: np.ndarray) -> None:
    """Fail unless this is one of ours, whole and as it was written."""
    if not isinstance(document, dict):
        raise ValueError("must hold one JSON object.")
    for name, value in _FIXED.items():
        if document.get(name) != value:
            raise ValueError(f"`{name}` must be {value!r}, got {document.get(name)!r}.")
    if wrong := sorted(_HEADER ^ set(document)):
        raise ValueError(f"lacks or should not have `{wrong[0]}`.")
    if _sealed(document, *arrays)["sha256"] != document["sha256"]:
        raise ValueError("was altered after it was written: its checksum differs.")


def _numbers(value: Any, name: str, shape: tuple[int, ...] | None) -> np.ndarray:
    try:
        numbers = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"`{name}` must be numbers of shape {shape}.") from error
    if shape is not None and numbers.shape != shape:
        raise ValueError(f"`{name}` must have shape {shape}, got {numbers.shape}.")
    if not np.isfinite(numbers).all():
        raise ValueError(f"`{name}` must be finite.")
    return numbers


def _tables(header: dict[str, Any], arrays: _Arrays) -> QualityTables:
    for name, array in arrays.items():
        _numbers(array, name, None)
    names = header["textures"]
    levels = _numbers(header["mip_levels"], "mip_levels", None).tolist()
    owners = [
        (names.index(owner["texture"]), tuple(map(float, owner["mip_levels"])))
        for owner in header["entries"]
    ]
    entry, occurs = index_entries(len(names), levels, owners)
    largest, percentile_99, median = arrays["errors"]
    variables = header["variables"]
    domain = {n: _numbers(variables[n]["domain"], n, (2,)) for n in _VARIABLES}
    tolerance = header["tolerance_jnd"]
    return QualityTables(
        coefficients=arrays["coefficients"],
        entry=entry,
        occurs=occurs,
        constant=np.array([bool(owner["constant"]) for owner in header["entries"]]),
        mip_levels=tuple(levels),
        domain=Domain(**domain),
        certificate=Certificate(
            largest=largest,
            percentile_99=percentile_99,
            median=median,
            overall=np.array(
                [header["certificate"][name] for name in _ERRORS], np.float32
            ),
            sample=Conditions(*arrays["sample"]),
        ),
        basis=basis_from(header["basis"]),
        rates=tuple(map(str, header["rates"])),
        texture_names=tuple(map(str, names)),
        model=str(header["model"]),
        relative_to=header["relative_to"],
        tolerance_jnd=None if tolerance is None else float(tolerance),
    )
