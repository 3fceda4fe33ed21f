"""Shader sources that evaluate packed records."""

from pathlib import Path

import numpy as np

from camojab._files import write_text

from .._rates import RATES
from ..tables import QualityTables
from ..tables._rate_order import SIDES
from ..tables._scales import TRAVEL
from ._dialects import commented, Dialect, DIALECTS
from ._records import Records, records


LANGUAGES = tuple(DIALECTS)
"""What `shader` writes: HLSL, GLSL 4.50, GLSL ES 3.10 and WGSL."""


def shader(tables: QualityTables | Records, language: str) -> str:
    """Source of a shader that gives the quality of every rate in every tile.

    It declares the record of `write_binary`, the constants of these tables, and

    - `float quality(record, velocity, refresh_rate, log10_luminance)` [JND], which
      moves the condition to the edge of the domain if it lies outside;
    - `uint record_index(texture_index, mip_level, rate, direction)`, which takes the
      nearest mip level, the finer of two, and the last texture or level beyond them;
    - `float log10_of(luminance)`, within the domain for any luminance >= 0;
    - `bool outside_domain(velocity, refresh_rate, log10_luminance)`, which tells
      whether `quality` moves the condition;
    - a compute entry point `main`, 64 threads a group, one a tile, which writes
      `qualities[tile * 7 + rate]`, the mean of both directions of motion, for the
      rates in the order of `alsarr.RATES`.

    Buffers are 0 `records` (the file of `write_binary` from byte 64), 1 `tiles`
    (texture_index as uint, mip_level, velocity_x, velocity_y [deg/s] >= 0 and
    luminance [cd/m^2], 20 bytes a tile), 2 the uniform `Frame` (refresh_rate [Hz] and
    num_tiles as uint), 3 `qualities`: binding in group or set 0, in HLSL t0, t1, b2
    and u3.

    **Arguments:**

    - `language`: one of `LANGUAGES`.

    **Raises:** `ValueError` for another language, and as `write_binary`.
    """
    if language not in DIALECTS:
        raise ValueError(
            f"`language` must be one of {', '.join(LANGUAGES)}, got {language}."
        )
    found = tables if isinstance(tables, Records) else records(tables)
    dialect = DIALECTS[language]
    parts = [
        dialect.first + commented(_about(found)),
        "",
        dialect.declarations(found.floats // 4),
        *_constants(dialect, found),
        "",
        *_quality(dialect, found),
        "",
        *_lookup(dialect),
        "",
        *_entry_point(dialect, found.rates == SIDES, found.coefficients.shape[0]),
    ]
    return "\n".join(parts) + "\n"


def write_shader(
    path: str | Path, tables: QualityTables | Records, language: str
) -> None:
    """Write the source that `shader` gives, whole or not at all.

    **Raises:** as `shader`.
    """
    write_text(path, shader(tables, language))


def _about(found: Records) -> str:
    relative = f", relative to {found.relative_to}" if found.relative_to else ""
    return (
        f"Quality of the shading rates {', '.join(RATES.names)} [JND]{relative}.\n"
        f"Model: {' '.join(found.model.split()) or 'see the tables'}\n"
        "records: the binary tables from byte 64. tiles: texture, mip level, velocity "
        "in x\nand y [deg/s], luminance [cd/m^2]. qualities: tile * 7 + rate."
    )


def _number(x: float | np.floating) -> str:
    text = f"{np.float32(x):.9g}"
    return text if set(text) & set(".e") else text + ".0"


def _constants(dialect: Dialect, found: Records) -> list[str]:
    _, textures, mips, rates, _ = found.coefficients.shape
    counts = {"TEXTURES": textures, "MIPS": mips, "RATES": rates}
    lines = [
        dialect.constant("uint", f"NUM_{name}", f"{count}u")
        for name, count in counts.items()
    ]
    names = ("VELOCITY", "REFRESH_RATE", "LOG10_LUMINANCE", "LUMINANCE")
    light = found.domain[2].astype(float)
    for name, ends in zip(names, [*found.domain, 10.0**light], strict=True):
        for which, end in zip(("LOW", "HIGH"), ends, strict=True):
            constant = dialect.constant("float", f"{name}_{which}", _number(end))
            lines.append(constant)
    return lines


def _quality(dialect: Dialect, found: Records) -> list[str]:
    parameters = [
        ("Record", "record"),
        ("float", "velocity"),
        ("float", "refresh_rate"),
        ("float", "log10_luminance"),
    ]
    clamped = {"v": "velocity", "f": "refresh_rate", "l": "log10_luminance"}
    lines = [
        dialect.let(
            "float", short, f"clamp({name}, {name.upper()}_LOW, {name.upper()}_HIGH)"
        )
        for short, name in clamped.items()
    ]
    body = _tensor if found.basis == "tensor" else _eq31
    lines += body(dialect, found)
    return [
        dialect.function("float", "quality", parameters),
        *(f"  {line}" for line in lines),
        "}",
    ]


def _w(index: int) -> str:
    return f"record.w[{index // 4}].{'xyzw'[index % 4]}"


def _eq31(dialect: Dialect, found: Records) -> list[str]:
    w = [_w(i) for i in range(10)]
    travel = f"log(1.0 + v / ({_number(TRAVEL)} * f))"
    u = travel if found.basis == "eq31-log-travel" else "v"
    motion = (
        f"{w[0]} + u * ({w[1]} + {w[3]} * u + {w[4]} * f) + f * ({w[2]} + {w[5]} * f)"
    )
    light = f"{w[9]} + l * ({w[8]} + l * ({w[7]} + l * {w[6]}))"
    return [
        dialect.let("float", "u", u),
        dialect.let("float", "motion", motion),
        dialect.let("float", "light", light),
        "return motion * light;",
    ]


def _tensor(dialect: Dialect, found: Records) -> list[str]:
    velocity, refresh_rate, level = found.domain.astype(float)
    shortest = found.shortest_travel
    travel = np.maximum(velocity / refresh_rate[::-1], shortest)
    lines = [
        *_logarithm(dialect, "x", f"max(v / f, {_number(shortest)})", *travel),
        *_logarithm(dialect, "y", "f", *refresh_rate),
        *_scaled(dialect, "z", f"(l - {_number(np.mean(level))})", *level),
    ]
    for axis, degree in zip("xyz", found.degrees, strict=True):
        lines += _chebyshev(dialect, axis, degree)
    size_y, size_z = found.degrees[1] + 1, found.degrees[2] + 1
    for i in range(found.degrees[0] + 1):
        planes = []
        for j in range(size_y):
            first = (i * size_y + j) * size_z
            planes.append([_w(first + k) for k in range(size_z)])
        inner = [_sum(plane, "z") for plane in planes]
        lines.append(dialect.let("float", f"a{i}", _sum(inner, "y")))
    terms = [f"a{i}" for i in range(found.degrees[0] + 1)]
    return [*lines, f"return {_sum(terms, 'x')};"]


def _logarithm(
    dialect: Dialect, axis: str, value: str, low: float, high: float
) -> list[str]:
    """The logarithm of `value`, mapped to [-1, 1] from its ends.

    That of the ratio to their middle rounds less than a difference of logarithms.
    """
    middle = np.sqrt(low * high)
    ratio = f"log({value} / {_number(middle)})"
    return _scaled(dialect, axis, ratio, np.log(low), np.log(high))


def _scaled(
    dialect: Dialect, axis: str, centred: str, low: float, high: float
) -> list[str]:
    half = (high - low) / 2
    value = f"{centred} / {_number(half)}" if half > 0 else "0.0"
    return [dialect.let("float", f"{axis}1", value)]


def _chebyshev(dialect: Dialect, axis: str, degree: int) -> list[str]:
    """Chebyshev polynomials 2 to `degree`."""
    lines = []
    for n in range(2, degree + 1):
        before = "1.0" if n == 2 else f"{axis}{n - 2}"
        next_ = f"2.0 * {axis}1 * {axis}{n - 1} - {before}"
        lines.append(dialect.let("float", f"{axis}{n}", next_))
    return lines


def _sum(terms: list[str], axis: str) -> str:
    """A sum of terms times Chebyshev polynomials, of which number 0 is 1.

    The highest come first: they are small, and single precision rounds small sums less.
    """
    times = [
        f"({term}) * {axis}{n}" if "+" in term else f"{term} * {axis}{n}"
        for n, term in enumerate(terms)
    ]
    return " + ".join([*times[:0:-1], terms[0]])


def _lookup(dialect: Dialect) -> list[str]:
    parameters = [
        ("uint", "texture_index"),
        ("float", "mip_level"),
        ("uint", "rate"),
        ("uint", "direction"),
    ]
    last = dialect.cast("float", "NUM_MIPS - 1u")
    nearest = dialect.cast("uint", f"clamp(ceil(mip_level - 0.5), 0.0, {last})")
    return [
        dialect.function("uint", "record_index", parameters),
        "  " + dialect.let("uint", "known", "min(texture_index, NUM_TEXTURES - 1u)"),
        "  " + dialect.let("uint", "mip", f"min({nearest}, NUM_MIPS - 1u)"),
        "  return ((direction * NUM_TEXTURES + known) * NUM_MIPS + mip) * NUM_RATES"
        " + rate;",
        "}",
        "",
        dialect.function("float", "log10_of", [("float", "luminance")]),
        "  return log2(clamp(luminance, LUMINANCE_LOW, LUMINANCE_HIGH))"
        f" * {_number(np.log10(2))};",
        "}",
        "",
        *_outside(dialect),
    ]


def _outside(dialect: Dialect) -> list[str]:
    """Whether `quality` moves a condition to the edge of the domain."""
    names = ("velocity", "refresh_rate", "log10_luminance")
    beyond = [f"{n} < {n.upper()}_LOW || {n} > {n.upper()}_HIGH" for n in names]
    return [
        dialect.function("bool", "outside_domain", [("float", n) for n in names]),
        f"  return {' || '.join(beyond)};",
        "}",
    ]


def _entry_point(dialect: Dialect, separable: bool, directions: int) -> list[str]:
    at = [("Tile", "at"), ("uint", "rate"), ("uint", "direction"), ("float", "speed")]
    index = "record_index(at.texture_index, at.mip_level, rate, direction)"
    lines = [
        dialect.function("float", "quality_at", at),
        f"  return quality(records[{index}], speed, {dialect.frame}refresh_rate,"
        " log10_of(at.luminance));",
        "}",
        "",
        dialect.entry(),
        f"  if (tile >= {dialect.frame}num_tiles) {{ return; }}",
        "  " + dialect.let("Tile", "at", "tiles[tile]"),
    ]
    calls = (
        "quality_at(at, {}, 0u, at.velocity_x)",
        (f"quality_at(at, {{}}, {directions - 1}u, at.velocity_y)"),
    )
    body = _separable(dialect, calls) if separable else _seven(dialect, calls)
    return [*lines, *(f"  {line}" for line in body), "}"]


def _seven(dialect: Dialect, calls: tuple[str, str]) -> list[str]:
    x, y = (call.format("rate") for call in calls)
    return [
        dialect.loop("rate", f"{len(RATES)}u"),
        f"  qualities[tile * {len(RATES)}u + rate] = 0.5 * ({x} + {y});",
        "}",
    ]


def _separable(dialect: Dialect, calls: tuple[str, str]) -> list[str]:
    lines = []
    for axis, call in zip("xy", calls, strict=True):
        for place, side in enumerate(SIDES):
            value = call.format(f"{place}u")
            lines.append(dialect.let("float", f"{axis}{side}", value))
    for rate, (m, n) in enumerate(RATES.size):
        both = f"0.5 * (x{m} + y{n})"
        lines.append(f"qualities[tile * {len(RATES)}u + {rate}u] = {both};")
    return lines
