"""Energies of many conditions as functions of the pooling exponent alone.

An energy is sum(w x^beta) = sum(w exp(beta log x)): a histogram of log x, with the mean
of every cell, keeps all that the exponent can see. Refitting then needs no spectrum.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._condition import Condition, Field, flattened
from .._parameters import Formulation
from .._quality import CHAIN
from .._spectrum import Spectrum


class Moments(eqx.Module):
    """Histograms of log amplitude: reference, shaded and replica of each condition.

    - `log`: mean of each cell. [1].
    - `weight`: total weight of each cell. [1], >= 0.
    """

    log: Float[Array, "conditions 3 cells"]
    weight: Float[Array, "conditions 3 cells"]

    def distortion(
        self, beta: Float[Array, ""]
    ) -> tuple[Float[Array, " conditions"], Float[Array, " conditions"]]:
        """Spatial and temporal distortion at an exponent. Differentiable. [1]."""
        energy = jnp.sum(self.weight * jnp.exp(beta * self.log), axis=-1)
        return energy[:, 0] - energy[:, 1], energy[:, 2]


def moments(
    spectrum: Spectrum,
    conditions: Condition,
    *,
    formulation: Formulation = Formulation.RELEASED,
    cells: int = 4096,
) -> Moments:
    """Moments of one texture under many conditions, whose `beta` has no effect.

    **Arguments:** `conditions`: fields of shapes that broadcast; flattened in the
    result. `cells`: of each histogram; the error falls with their square.

    **Accuracy:** the distortions agree with the model's to 1e-6 of the reference's
    energy at 4 096 cells (`tests/fit/test_moments.py`).
    """
    shape, conditions = flattened(conditions, spectrum.amplitude.dtype)
    one = []
    for i in range(math.prod(shape)):
        condition = jax.tree.map(lambda x, i=i: x[i], conditions)
        one.append(_histograms(_fields(spectrum, condition, formulation), cells))
    log, weight = (np.stack(part) for part in zip(*one, strict=True))
    return Moments(jnp.asarray(log, float), jnp.asarray(weight, float))


@eqx.filter_jit
def _fields(
    spectrum: Spectrum, condition: Condition, formulation: Formulation
) -> tuple[Field, Field, Field]:
    return CHAIN[formulation].fields(spectrum.amplitude, condition)


def _histograms(
    fields: tuple[Field, Field, Field], cells: int
) -> tuple[np.ndarray, np.ndarray]:
    log, weight = zip(*(_histogram(field, cells) for field in fields), strict=True)
    return np.stack(log), np.stack(weight)


def _histogram(field: Field, cells: int) -> tuple[np.ndarray, np.ndarray]:
    log, weight = np.asarray(field.log).ravel(), np.asarray(field.weight).ravel()
    some = np.isfinite(log) & (weight > 0)
    log, weight = log[some], weight[some]
    if not log.size:
        return np.zeros(cells), np.zeros(cells)
    low, high = log.min(), log.max()
    scale = (cells - 1) / (high - low) if high > low else 0.0
    cell = ((log - low) * scale).astype(np.intp)
    total = np.bincount(cell, weight, cells)
    first = np.bincount(cell, weight * log, cells)
    return np.divide(first, total, out=np.zeros(cells), where=total > 0), total
