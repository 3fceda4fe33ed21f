"""FLIP's filters, all of them sums of products of a row and a column."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ._colour import total


# Of the contrast sensitivity: a and b of Andersson et al. 2020, Table 1. [deg^2] for b.
_ACHROMATIC = ((1.0, 0.0047),)
_RED_GREEN = ((1.0, 0.0053),)
_BLUE_YELLOW = ((34.1, 0.04), (13.5, 0.025))
_FEATURE_WIDTH = 0.082


def sensitivity_rows(ppd: float) -> list[list[Float[np.ndarray, " taps"]]]:
    """Rows of the three channels' filters, each channel a sum of row times column.

    **Arguments:** `ppd`: [px/deg], > 0.

    **Returns:** for Y, Cx and Cz rows of odd length. The filter of a channel is the sum
    of each row's product with itself as a column, and its weights have the sum 1.

    **Source:** Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating
    Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), doi:10.1145/3406183,
    section 4.1.1.
    """
    widest = max(b for _, b in _BLUE_YELLOW)
    radius = math.ceil(3 * math.sqrt(widest / (2 * math.pi**2)) * ppd)
    x = np.arange(-radius, radius + 1) / ppd
    return [_rows(x, terms) for terms in (_ACHROMATIC, _RED_GREEN, _BLUE_YELLOW)]


def feature_rows(ppd: float) -> tuple[Float[np.ndarray, " taps"], ...]:
    """A Gaussian and its first two derivatives, for points and edges.

    The Gaussian's weights have the sum 1; of each derivative, the positive weights have
    the sum 1 and the negative ones -1.

    **Source:** Andersson et al. 2020, section 4.2.
    """
    deviation = 0.5 * _FEATURE_WIDTH * ppd
    radius = math.ceil(3 * deviation)
    x = np.arange(-radius, radius + 1) / deviation
    gauss = np.exp(-(x**2) / 2)
    return gauss / gauss.sum(), _balanced(-x * gauss), _balanced((x**2 - 1) * gauss)


def extended(
    plane: Float[Array, "height width"], margin: int
) -> Float[Array, "higher wider"]:
    """A plane with a margin in which its outermost pixels go on."""
    return jnp.pad(plane, margin, mode="edge")


def across(
    plane: Float[Array, "height wider"], row: Float[np.ndarray, " taps"], margin: int
) -> Float[Array, "height width"]:
    """Correlate every line with `row`, for all columns but those of the margin."""
    return _along(plane, row, margin, 1)


def down(
    plane: Float[Array, "higher width"], column: Float[np.ndarray, " taps"], margin: int
) -> Float[Array, "height width"]:
    """The same for columns, and all lines but those of the margin."""
    return _along(plane, column, margin, 0)


def _rows(
    x: Float[np.ndarray, " taps"], terms: tuple[tuple[float, float], ...]
) -> list[Float[np.ndarray, " taps"]]:
    rows = [
        math.sqrt(a * math.sqrt(math.pi / b)) * np.exp(-((math.pi * x) ** 2) / b)
        for a, b in terms
    ]
    total = math.sqrt(sum(row.sum() ** 2 for row in rows))
    return [row / total for row in rows]


def _balanced(row: Float[np.ndarray, " taps"]) -> Float[np.ndarray, " taps"]:
    up, low = np.maximum(row, 0), np.minimum(row, 0)
    return up / up.sum() - low / low.sum()


def _along(plane: Array, row: np.ndarray, margin: int, axis: int) -> Array:
    first = margin - len(row) // 2
    size = plane.shape[axis] - 2 * margin
    within = lax.slice_in_dim(plane, first, first + size + len(row) - 1, axis=axis)
    return _correlated(tuple(row.tolist()), axis, within)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _correlated(row: tuple[float, ...], axis: int, plane: Array) -> Array:
    size = plane.shape[axis] - len(row) + 1
    # Shifted slices, added term by term, become one loop over the pixels.
    return total(
        weight * lax.slice_in_dim(plane, start, start + size, axis=axis)
        for start, weight in enumerate(row)
        if weight
    )


@_correlated.defjvp
def _correlated_jvp(
    row: tuple[float, ...], axis: int, primals: tuple[Array], tangents: tuple[Array]
) -> tuple[Array, Array]:
    """The same as a product with a band: XLA takes minutes to transpose slices."""
    (tangent,) = tangents
    size = tangent.shape[axis] - len(row) + 1
    band = _band(row, size, tangent.dtype)
    pair = (tangent, band) if axis else (band.T, tangent)
    # A GPU would otherwise round to ten bits.
    found = jnp.matmul(*pair, precision="highest")
    return _correlated(row, axis, *primals), found


def _band(
    row: tuple[float, ...], size: int, dtype: jnp.dtype
) -> Float[Array, "longer size"]:
    """The matrix that correlates lines, multiplied from the right."""
    start = jnp.arange(size)[None, :]
    place = jnp.arange(size + len(row) - 1)[:, None] - start
    weight = jnp.asarray(row, dtype)[jnp.clip(place, 0, len(row) - 1)]
    return jnp.where((place >= 0) & (place < len(row)), weight, 0)
