"""The fitted constants of the model, and their files."""

import enum
import json
import math
from collections.abc import Mapping
from pathlib import Path

import equinox as eqx
from jaxtyping import Array, ArrayLike, Float

from ._display import brief
from ._errors import check
from ._files import write_text
from ._shipped import shipped


SCHEMA = "camojab-parameters/1"


class Formulation(enum.Enum):
    """Which of the two statements of the model is evaluated.

    `RELEASED` is the authors' program, to the bin; `PAPER` is Eq. 1 to 23 as printed,
    made of continuous functions. Constants belong to the formulation they were fitted
    with.
    """

    RELEASED = "released"
    PAPER = "paper"


class Parameters(eqx.Module):
    """Fitted constants of the model.

    **Arguments:** (scalars, or any shapes that broadcast with the conditions)

    - `ws`, `wt`: quality per unit of spatial and of temporal distortion. [JND],
      finite; negative, since distortions lower quality.
    - `beta`: exponent of the energy pooling. [1], > 0.
    - `ca`, `cb`: eye blur per velocity [s] and at rest [deg] at full persistence, >= 0.

    **Source:** Jindal et al. 2021, Eq. 1, 15 and 19 and Table 4; ca and cb of Denes et
    al. 2020, Table 1.
    """

    ws: Float[Array, "..."]
    wt: Float[Array, "..."]
    beta: Float[Array, "..."]
    ca: Float[Array, "..."]
    cb: Float[Array, "..."]

    def __init__(
        self,
        *,
        ws: ArrayLike,
        wt: ArrayLike,
        beta: ArrayLike,
        ca: ArrayLike = 0.001648,
        cb: ArrayLike = 0.079818,
    ):
        self.ws = check("ws", ws, _finite, "finite [JND]")
        self.wt = check("wt", wt, _finite, "finite [JND]")
        self.beta = check("beta", beta, lambda x: (x > 0) & _finite(x), "finite, > 0")
        self.ca = check("ca", ca, lambda x: (x >= 0) & _finite(x), "finite, >= 0 s")
        self.cb = check("cb", cb, lambda x: (x >= 0) & _finite(x), "finite, >= 0 deg")

    @classmethod
    def published(cls, formulation: Formulation = Formulation.RELEASED) -> "Parameters":
        """The shipped constants of a formulation (`data/parameters_*.json`)."""
        return load_parameters(shipped(f"parameters_{formulation.value}.json"))[0]

    def report(self) -> str:
        """One line to quote beside any number."""
        return ", ".join(f"{k}={brief(v, 8)}" for k, v in vars(self).items())


def _finite(x: Array) -> Array:
    return abs(x) < math.inf


UNITS = {"ws": "JND", "wt": "JND", "beta": "1", "ca": "s", "cb": "deg"}


def save_parameters(
    path: str | Path,
    parameters: Parameters,
    formulation: Formulation,
    *,
    provenance: str,
    details: Mapping[str, object] | None = None,
) -> None:
    """Write parameters as JSON, whole or not at all.

    `provenance` says what they were fitted to, and when. `details` adds further entries
    to the file, which `load_parameters` leaves alone.
    """
    document = {
        **(details or {}),
        "schema": SCHEMA,
        "formulation": formulation.value,
        "parameters": {name: float(getattr(parameters, name)) for name in UNITS},
        "units": UNITS,
        "provenance": provenance,
    }
    write_text(path, json.dumps(document, indent=1) + "\n")


def load_parameters(path: str | Path) -> tuple[Parameters, Formulation]:
    """Read a file of `save_parameters`, or any JSON with the same two entries.

    **Raises:** `ValueError` naming the file and the entry that is missing or wrong.
    """
    try:
        document = json.loads(Path(path).read_text())
        values = dict(document["parameters"])
        formulation = Formulation(document["formulation"])
        known = {name: values.pop(name) for name in UNITS if name in values}
        if values:
            raise ValueError(f"unknown parameter {next(iter(values))!r}")
        missing = [name for name in ("ws", "wt", "beta") if name not in known]
        if missing:
            raise ValueError(f"parameter {missing[0]!r} is missing")
        for name, value in known.items():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"parameter {name!r} must be a number, got {value!r}")
        return Parameters(**known), formulation
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: not a parameter file: {error}.") from error
