"""A table of conditions -> the model's predictions, row by row."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import ArrayLike, Float, Int

from ._columns import (
    check_columns,
    check_finite,
    FLAG,
    FRACTION,
    not_negative,
    numbers,
    positive,
    Problem,
    Rule,
    TableError,
)
from ._condition import Condition, flattened
from ._display import Components, Display, Shading, Viewing
from ._exact import Exact
from ._fidelity import AbstractFidelity, Distortion
from ._parameters import Formulation, Parameters
from ._quality import distortion
from ._spectrum import luminance, Spectrum
from ._textures import Source, sources


if TYPE_CHECKING:
    import pandas


REQUIRED: dict[str, Rule] = {
    "mean_luminance_cd_m2": positive("cd/m^2"),
    "refresh_rate_hz": positive("Hz"),
    "velocity_deg_s": not_negative("deg/s"),
    "persistence": FRACTION,
    "ppd": positive("px/deg"),
    "rate_x": FRACTION,
    "rate_y": FRACTION,
    "mip_level": not_negative(),
}
OPTIONAL: dict[str, Rule] = {
    "beta": positive(),
    "vrs": FLAG,
    "eye_blur": FLAG,
    "judder": FLAG,
}
# What a call costs beside its conditions, in conditions.
CALL = 1
ADDED: tuple[str, ...] = ("spatial_distortion", "temporal_distortion", "quality_jnd")


def predict(
    table: "pandas.DataFrame",
    *,
    formulation: Formulation = Formulation.RELEASED,
    parameters: Parameters | None = None,
    textures: Mapping[str, ArrayLike] | None = None,
    encoding: str | None = None,
    folder: str | Path | None = None,
    fidelity: AbstractFidelity | None = None,
) -> "pandas.DataFrame":
    """Distortions and quality of every row of a table of conditions.

    Each texture is read once, and memory does not grow with the number of rows or
    textures. Computed in JAX's default precision.

    **Arguments:**

    - `table`: one condition a row, in the columns

        - `texture`: a key of `textures`, `"jindal2021:NAME"` for a texture of
            `datasets.jindal2021_textures`, `"builtin:NAME"` for one of
            `datasets.builtin_textures`, or the path of an image or of an array in a
            `.npy` file, relative to the working directory or else to `folder`;
        - `mean_luminance_cd_m2` [cd/m^2], > 0; `refresh_rate_hz` [Hz], > 0;
            `velocity_deg_s` [deg/s], >= 0; `persistence`, in (0, 1]; `ppd` [px/deg],
            > 0; `rate_x` and `rate_y`, in (0, 1]; `mip_level`, >= 0;
        - optionally `beta`, > 0, in the place of that of `parameters`, and `vrs`,
            `eye_blur` and `judder`, 0 or 1, the parts of `Components` that take part.

        Further columns are left as they are.
    - `parameters`: the published ones of `formulation` if left out; each constant a
        scalar.
    - `textures`: textures by name, as `Spectrum.from_texture` takes them.
    - `encoding`: of the image files and of `textures`, as `Spectrum.from_texture` takes
        it; without it colour is an error and grey is relative luminance as it stands.
        The textures of `datasets` are luminance already.
    - `fidelity`: as `distortion`; rows that share texture, mip level, rates and `beta`
        make a setting.

    **Returns:** a copy of the table with the further columns `spatial_distortion` [1],
    `temporal_distortion` [1] and `quality_jnd` [JND], as `distortion` and `quality`
    define them.

    **Raises:** `TableError`, a `ValueError`, for a missing or repeated column, a column
    that has the name of one to be added, a number out of range or a texture that cannot
    be used; its `problems` name every such cell. `ValueError` for an unknown encoding.

    **Accuracy:** as `distortion`.

    **Source:** Jindal et al. 2021, Eq. 1 to 23.

    **Example:**

    >>> import numpy as np
    >>> import pandas as pd
    >>> from camojab import predict
    >>> settings = dict(texture="noise", mip_level=0, rate_x=[1.0, 0.5], rate_y=1.0)
    >>> shown = dict(mean_luminance_cd_m2=100, persistence=1, ppd=60)
    >>> moving = dict(velocity_deg_s=10, refresh_rate_hz=60)
    >>> noise = np.random.default_rng(0).uniform(size=(512, 512))
    >>> table = pd.DataFrame(settings | shown | moving)
    >>> table = predict(table, textures={"noise": noise})
    >>> print(table["quality_jnd"].to_numpy().round(1))
    [-24.9 -27.8]
    """
    names = [str(name) for name in table.columns]
    check_columns(names, required=("texture", *REQUIRED), added=ADDED)
    added = predictions(
        {name: list(table[name]) for name in names if name in known()},
        formulation=formulation,
        parameters=parameters or Parameters.published(formulation),
        textures=textures or {},
        encoding=encoding,
        folder=folder,
        fidelity=fidelity or Exact(),
    )
    return table.assign(**added)


def known() -> list[str]:
    """The columns that `predict` reads."""
    return ["texture", *REQUIRED, *OPTIONAL]


def predictions(
    columns: Mapping[str, Sequence[Any]],
    *,
    formulation: Formulation,
    parameters: Parameters,
    textures: Mapping[str, ArrayLike],
    encoding: str | None,
    folder: str | Path | None,
    fidelity: AbstractFidelity,
    progress: Callable[[int], None] = lambda rows: None,
) -> dict[str, Float[np.ndarray, " rows"]]:
    """The columns that `predict` adds; `progress` is told of rows as they are done.

    Cells may be texts of numbers. **Raises:** as `predict`.
    """
    if encoding is not None:
        luminance(np.zeros((1, 1)), encoding=encoding)
    dtype = np.dtype(jnp.result_type(float))
    rules = REQUIRED | {k: rule for k, rule in OPTIONAL.items() if k in columns}
    values, problems = numbers(columns, rules, dtype)
    groups = _rows_by_texture(columns["texture"])
    found, unknown = sources(groups, textures, encoding, folder)
    problems += [Problem(int(groups[n][0]), text) for n, text in unknown.items()]
    if problems:
        raise TableError.of(problems)
    conditions = _conditions(values, parameters, dtype)
    way = formulation, fidelity
    spatial, temporal = _evaluated(groups, found, conditions, way, progress)
    weights = conditions.parameters
    quality = np.asarray(weights.ws * spatial + weights.wt * temporal)
    check_finite("quality_jnd", quality)
    return dict(zip(ADDED, (spatial, temporal, quality), strict=True))


def _conditions(
    values: Mapping[str, Float[np.ndarray, " rows"]],
    parameters: Parameters,
    dtype: np.dtype,
) -> Condition:
    """Every field as a NumPy array of one value a row."""
    given = lambda *names: {name: values[name] for name in names if name in values}
    condition = Condition(
        Display(
            ppd=values["ppd"],
            refresh_rate=values["refresh_rate_hz"],
            luminance=values["mean_luminance_cd_m2"],
            persistence=values["persistence"],
        ),
        Viewing(values["velocity_deg_s"]),
        Shading(**given("rate_x", "rate_y", "mip_level")),
        Components(**_flags(values)),
        Parameters(**vars(parameters) | given("beta")),
    )
    return jax.tree.map(np.asarray, flattened(condition, dtype)[1])


def _flags(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: values[k] for k in ("vrs", "eye_blur", "judder") if k in values}


def _evaluated(
    groups: Mapping[str, Int[np.ndarray, " n"]],
    found: Mapping[str, Source],
    conditions: Condition,
    way: tuple[Formulation, AbstractFidelity],
    progress: Callable[[int], None],
) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, " rows"]]:
    """Spatial and temporal distortion of all rows, one texture after the other."""
    spatial = np.zeros_like(conditions.display.ppd)
    temporal = np.zeros_like(spatial)
    sizes = [len(rows) for rows in groups.values()]
    length = _run_length(sizes) if way[1] == Exact() else max(sizes)
    problems = []
    for name, rows in groups.items():
        try:
            spectrum = Spectrum.from_texture(found[name]())
        except (OSError, ValueError) as error:
            problems.append(Problem(int(rows[0]), f"in {name!r}, {error}"))
            continue
        # Once a texture is broken, the others are only read, to report them too.
        if problems:
            continue
        for start in range(0, len(rows), length):
            run = rows[start : start + length]
            padded = np.pad(run, (0, length - len(run)), mode="edge")
            parts = _distortion(spectrum, conditions, padded, *way)
            spatial[padded], temporal[padded] = parts.spatial, parts.temporal
            progress(len(run))
    if problems:
        raise TableError.of(problems)
    return spatial, temporal


def _run_length(sizes: Sequence[int]) -> int:
    """How many conditions go through in a call: the same in all, to compile once.

    A texture's last call is padded, and a call costs as much again as some conditions.
    """
    cost = lambda length: sum(-(-size // length) for size in sizes) * (length + CALL)
    return min((2**k for k in range(9)), key=cost)


def _distortion(
    spectrum: Spectrum,
    conditions: Condition,
    rows: Int[np.ndarray, " n"],
    formulation: Formulation,
    fidelity: AbstractFidelity,
) -> Distortion:
    c = jax.tree.map(lambda field: jnp.asarray(field[rows]), conditions)
    return distortion(
        spectrum,
        c.display,
        c.viewing,
        c.shading,
        c.parameters,
        formulation=formulation,
        components=c.components,
        fidelity=fidelity,
    )


def _rows_by_texture(names: Iterable[Any]) -> dict[str, Int[np.ndarray, " n"]]:
    """The rows of every texture, in the order in which the table names them."""
    rows: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        rows.setdefault(str(name), []).append(row)
    return {name: np.array(of) for name, of in rows.items()}
