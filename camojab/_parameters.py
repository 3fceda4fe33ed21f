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
    - `mipmap_width`, `hold_width`, `pursuit_width`: factors on the width of the blurs
      of Eq. 8, 14 and 15. [1], > 0; 1 in the paper.
    - `achromatic_gain`, `red_green_gain`, `yellow_violet_gain`, `velocity_gain`:
      factors on the three mechanisms of the spatio-chromatic sensitivity and on the
      spatio-velocity one where something flickers. [1], > 0; 1 in the paper.

    **Source:** Jindal et al. 2021, Eq. 1, 15 and 19 and Table 4; ca and cb of Denes et
    al. 2020, Table 1.
    """

    ws: Float[Array, "..."]
    wt: Float[Array, "..."]
    beta: Float[Array, "..."]
    ca: Float[Array, "..."]
    cb: Float[Array, "..."]
    mipmap_width: Float[Array, "..."]
    hold_width: Float[Array, "..."]
    pursuit_width: Float[Array, "..."]
    achromatic_gain: Float[Array, "..."]
    red_green_gain: Float[Array, "..."]
    yellow_violet_gain: Float[Array, "..."]
    velocity_gain: Float[Array, "..."]

    def __init__(
        self,
        *,
        ws: ArrayLike,
        wt: ArrayLike,
        beta: ArrayLike,
        ca: ArrayLike = 0.001648,
        cb: ArrayLike = 0.079818,
        mipmap_width: ArrayLike = 1.0,
        hold_width: ArrayLike = 1.0,
        pursuit_width: ArrayLike = 1.0,
        achromatic_gain: ArrayLike = 1.0,
        red_green_gain: ArrayLike = 1.0,
        yellow_violet_gain: ArrayLike = 1.0,
        velocity_gain: ArrayLike = 1.0,
    ):
        self.ws = check("ws", ws, _finite, "finite [JND]")
        self.wt = check("wt", wt, _finite, "finite [JND]")
        self.beta = _factor("beta", beta)
        self.ca = check("ca", ca, lambda x: (x >= 0) & _finite(x), "finite, >= 0 s")
        self.cb = check("cb", cb, lambda x: (x >= 0) & _finite(x), "finite, >= 0 deg")
        self.mipmap_width = _factor("mipmap_width", mipmap_width)
        self.hold_width = _factor("hold_width", hold_width)
        self.pursuit_width = _factor("pursuit_width", pursuit_width)
        self.achromatic_gain = _factor("achromatic_gain", achromatic_gain)
        self.red_green_gain = _factor("red_green_gain", red_green_gain)
        self.yellow_violet_gain = _factor("yellow_violet_gain", yellow_violet_gain)
        self.velocity_gain = _factor("velocity_gain", velocity_gain)

    @classmethod
    def published(cls, formulation: Formulation = Formulation.RELEASED) -> "Parameters":
        """The shipped constants of a formulation (`data/parameters_*.json`).

        **Example:**

        >>> from camojab import Formulation, Parameters
        >>> for formulation in Formulation:
        ...     constants = Parameters.published(formulation)
        ...     print(formulation.value, f"{constants.ws:.3f} {constants.beta:.4f}")
        released -3.699 0.3597
        paper -0.001 0.5748
        """
        return load_parameters(shipped(f"parameters_{formulation.value}.json"))[0]

    def report(self) -> str:
        """One line to quote beside any number; factors that are 1 are left out."""
        told = {
            name: value
            for name, value in vars(self).items()
            if name not in FACTORS or (value != 1).any()
        }
        return ", ".join(f"{k}={brief(v, 8)}" for k, v in told.items())


def _finite(x: Array) -> Array:
    return abs(x) < math.inf


def _factor(name: str, value: ArrayLike) -> Array:
    return check(name, value, lambda x: (x > 0) & _finite(x), "finite, > 0")


FACTORS = (
    "mipmap_width",
    "hold_width",
    "pursuit_width",
    "achromatic_gain",
    "red_green_gain",
    "yellow_violet_gain",
    "velocity_gain",
)
UNITS = {
    **{"ws": "JND", "wt": "JND", "beta": "1", "ca": "s", "cb": "deg"},
    **dict.fromkeys(FACTORS, "1"),
}


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
