"""Energies of many conditions as functions of the pooling exponent alone.

An energy is sum(w x^beta) = sum(w exp(beta log x)). The Gauss quadrature of the measure
w over log x keeps all that the exponent can see of a quarter of a million bins in a few
dozen nodes, so that refitting needs no spectrum and no time.
"""

import hashlib
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._chains import CHAIN
from .._condition import Condition, Field, flattened
from .._parameters import Formulation, Parameters
from .._spectrum import Spectrum


# Cells of the histogram that comes first, finer towards its top, where energy is; each
# keeps four moments.
_CELLS = 512

# Amplitudes that are smaller than the largest by more than exp(-300) are raised to it.
_SPAN = 300.0

# Exponent that the quadrature is most accurate at: below the fitted ones, or the tail
# of amplitudes that are all but zero would take the nodes.
_TILT = 0.25


class Moments(eqx.Module):
    """Nodes and weights of log amplitude: reference, shaded and replica of each row.

    - `log`: of each node. [1].
    - `weight`: of each node. [1], >= 0; 0 for a node that is not needed.
    """

    log: Float[Array, "conditions 3 nodes"]
    weight: Float[Array, "conditions 3 nodes"]

    def distortion(
        self, parameters: Parameters
    ) -> tuple[Float[Array, " conditions"], Float[Array, " conditions"]]:
        """Spatial and temporal distortion at an exponent. Differentiable. [1].

        Only `beta` of the parameters has an effect.
        """
        energy = jnp.sum(self.weight * jnp.exp(parameters.beta * self.log), axis=-1)
        return energy[:, 0] - energy[:, 1], energy[:, 2]


def moments(
    spectrum: Spectrum,
    conditions: Condition,
    *,
    formulation: Formulation = Formulation.RELEASED,
    nodes: int = 32,
) -> Moments:
    """Moments of one texture under many conditions, whose `beta` has no effect.

    **Arguments:** `conditions`: fields of shapes that broadcast; flattened in the
    result. `nodes`: of each quadrature; >= 1.

    **Accuracy:** energies agree with the model's to a relative error of 1e-8 for
    exponents from 0.05 to 2; those of a regular texture, such as a checkerboard, under
    `PAPER` to 1e-7 from 0.1 to 1.5 and to 1e-5 beyond (`tests/fit/test_moments.py`).

    **Source:** quadrature from moments by the recurrence of Lanczos: Golub and Welsch
    1969, doi:10.2307/2004418.
    """
    shape, conditions = flattened(conditions, spectrum.amplitude.dtype)
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    one = []
    for i in range(math.prod(shape)):
        condition = jax.tree.map(lambda x, i=i: x[i], conditions)
        reference, *others = _fields(spectrum, condition, formulation)
        # Many rows are seen against the same reference.
        parts = (np.asarray(x).tobytes() for x in (reference.log, reference.weight))
        same = hashlib.sha256(b"".join(parts)).digest()
        if same not in known:
            known[same] = _quadrature(*_histogram(reference), nodes)
        one.append(known[same])
        one += [_quadrature(*_histogram(field), nodes) for field in others]
    log, weight = (
        np.stack(part).reshape(-1, 3, nodes) for part in zip(*one, strict=True)
    )
    return Moments(jnp.asarray(log, float), jnp.asarray(weight, float))


@eqx.filter_jit
def _fields(
    spectrum: Spectrum, condition: Condition, formulation: Formulation
) -> tuple[Field, Field, Field]:
    return CHAIN[formulation].fields(spectrum.amplitude, condition)


def _histogram(field: Field) -> tuple[np.ndarray, np.ndarray]:
    """Two points a cell, which keep its first four moments: at most 1024 points."""
    log, weight = (np.asarray(x, np.float64).ravel() for x in (field.log, field.weight))
    some = np.isfinite(log) & (weight > 0)
    log, weight = log[some], weight[some]
    if not log.size:
        return np.zeros(1), np.zeros(1)
    high = log.max()
    below = np.minimum(high - log, _SPAN)
    span = below.max() or 1.0
    cell = np.minimum((np.sqrt(below / span) * _CELLS).astype(np.intp), _CELLS - 1)
    # Moments about the middle of the cell lose no digits.
    middle = high - span * ((np.arange(_CELLS) + 0.5) / _CELLS) ** 2
    t = high - below - middle[cell]
    moments = []
    for _ in range(4):
        moments.append(np.bincount(cell, weight, _CELLS))
        weight = weight * t
    total, first, second, third = moments
    used = total > 0
    total = total[used]
    mean, second, third = (moment[used] / total for moment in (first, second, third))
    variance = np.maximum(second - mean**2, 0.0)
    skew = third - mean * (3.0 * second - 2.0 * mean**2)
    half = 0.5 * np.divide(skew, variance, out=np.zeros_like(mean), where=variance > 0)
    root = np.sqrt(half**2 + variance)
    share = np.divide(half, root, out=np.zeros_like(mean), where=root > 0)
    points = np.stack([half - root, half + root]) + mean + middle[used]
    weights = total * 0.5 * np.stack([1.0 + share, 1.0 - share])
    return points.ravel(), weights.ravel()


def _quadrature(
    points: np.ndarray, weights: np.ndarray, nodes: int
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss quadrature of the tilted measure; exact where there are few points."""
    log, weight = np.zeros(nodes), np.zeros(nodes)
    some = weights > 0
    points, weights = points[some], weights[some]
    if not points.size:
        return log, weight
    top = points.max()
    weights = weights * np.exp(_TILT * (points - top))
    total = weights.sum()
    basis = np.zeros((nodes, points.size))
    diagonal, beside = np.zeros(nodes), np.zeros(nodes)
    vector, count = np.sqrt(weights / total), 0
    scale = np.abs(points).max() + 1.0
    for k in range(nodes):
        basis[k], count = vector, k + 1
        diagonal[k] = vector @ (points * vector)
        vector = points * vector
        # Twice is enough for vectors that are orthogonal to the last digit.
        for _ in range(2):
            vector -= basis[:count].T @ (basis[:count] @ vector)
        beside[k] = np.linalg.norm(vector)
        if beside[k] <= 1e-13 * scale:
            break
        vector /= beside[k]
    matrix = np.diag(diagonal[:count]) + np.diag(beside[: count - 1], 1)
    log[:count], vectors = np.linalg.eigh(matrix, "U")
    weight[:count] = total * vectors[0] ** 2 * np.exp(_TILT * (top - log[:count]))
    return log, weight
