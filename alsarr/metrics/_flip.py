"""FLIP for pictures as a display shows them."""

import math
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from camojab._math import safe_hypot, safe_power

from ._checks import checked_pair, checked_ppd
from ._colour import emitted, hunt_lab, opponent, Planes, shown, total
from ._filters import across, down, extended, feature_rows, sensitivity_rows


_COLOUR_EXPONENT = 0.7
_FEATURE_EXPONENT = 0.5
# The share of the largest colour difference that comes to so much of [0, 1].
_KNEE, _KNEE_VALUE = 0.4, 0.95


def flip(
    reference: ArrayLike, test: ArrayLike, *, ppd: ArrayLike
) -> Float[Array, "height width"]:
    r"""Difference that is seen when two pictures take turns at one place.

    $$\Delta E = \Delta E_c^{\,1 - \Delta E_f}$$

    of the colours that the eye resolves, and of edges and points.

    **Arguments:**

    - `reference`, `test`: sRGB-encoded, shape [height, width, 3]. [1], in [0, 1];
      integers count from 0 to the largest value of their type.
    - `ppd`: pixels to a visual degree, a plain number. [px/deg], in [1, 1000]. There is
      no default: 67 stands for a screen of 3840 px and 0.7 m at 0.7 m, and Cardoso et
      al. 2022 take width times pi / 180, 33.5 at 1920 px. A new value compiles anew.

    **Returns:** error of each pixel, 0 where the pictures look alike, about 1 at most.
    [1]. It is the same with the pictures exchanged. Differentiable in both; where
    colours or features are equal, the derivative of their difference is taken as 0.

    **Raises:** `ValueError` for pictures of another shape or of two, values out of
    range, or a `ppd` that is traced or out of range; under a JAX transformation values
    are checked at run time.

    **Accuracy:** within 1e-4 of flip-evaluator 1.7, which computes in float32
    (`tests/alsarr/test_alsarr_metrics_flip.py`). Fastest outside `jit`: its stages are
    programs of their own, which `jit` merges into a slower one. Derivatives go through
    matrices of the picture's width and height, and cost more a pixel the larger it is.

    **Source:** Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating
    Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), doi:10.1145/3406183, with
    the constants of NVlabs/flip (BSD-3-Clause).

    **Example:**

    >>> import numpy as np
    >>> from alsarr.metrics import flip
    >>> black, white = np.zeros((16, 16, 3)), np.ones((16, 16, 3))
    >>> f"{flip(black, white, ppd=67).mean():.2f}"
    '0.97'
    """
    pair = checked_pair(reference, test)
    return difference(checked_ppd(ppd), emitted, *((image,) for image in pair))


def difference(
    ppd: float,
    light_of: Callable[..., Planes],
    reference: tuple[Array, ...],
    test: tuple[Array, ...],
) -> Float[Array, "height width"]:
    """FLIP of what `light_of` makes of the arguments of two pictures."""
    # Plain numbers and functions are static to `filter_jit`. In one program XLA would
    # repeat each stage for many terms of the next.
    colour, lightness = [], []
    for arguments in (reference, test):
        wide = _wide(arguments, light_of=light_of, ppd=ppd)
        colours, features = _down(_across(wide, ppd=ppd), ppd=ppd)
        colour.append(_lab(colours))
        lightness.append(features)
    return _combined(colour, lightness)


@eqx.filter_jit
def _wide(
    arguments: tuple[Array, ...], *, light_of: Callable[..., Planes], ppd: float
) -> Planes:
    y, cx, cz = opponent(light_of(*arguments))
    margin = _margin(ppd)
    return extended(y, margin), extended(cx, margin), extended(cz, margin)


@eqx.filter_jit
def _across(wide: Planes, *, ppd: float) -> tuple[list[list[Array]], list[Array]]:
    margin = _margin(ppd)
    colours = [
        [across(plane, row, margin) for row in rows]
        for plane, rows in zip(wide, sensitivity_rows(ppd), strict=True)
    ]
    lightness = wide[0] / 116
    return colours, [across(lightness, row, margin) for row in feature_rows(ppd)]


@eqx.filter_jit
def _down(
    half: tuple[list[list[Array]], list[Array]], *, ppd: float
) -> tuple[Planes, tuple[Array, Array]]:
    """The blurred colours, and how much of an edge and of a point there is."""
    margin = _margin(ppd)
    y, cx, cz = (
        total(down(part, row, margin) for part, row in zip(parts, rows, strict=True))
        for parts, rows in zip(half[0], sensitivity_rows(ppd), strict=True)
    )
    gauss, slope, bend = feature_rows(ppd)
    smooth, slopes, bends = half[1]
    edge = safe_hypot(down(slopes, gauss, margin), down(smooth, slope, margin))
    point = safe_hypot(down(bends, gauss, margin), down(smooth, bend, margin))
    return (y, cx, cz), (edge, point)


@eqx.filter_jit
def _lab(colours: Planes) -> Planes:
    return hunt_lab(shown(colours))


@eqx.filter_jit
def _combined(
    colours: list[Planes], features: list[tuple[Array, Array]]
) -> Float[Array, "height width"]:
    feature = _feature_difference(*features)
    return safe_power(_colour_difference(*colours), 1 - feature)


def _margin(ppd: float) -> int:
    rows = [row for rows in sensitivity_rows(ppd) for row in rows]
    return max(len(row) // 2 for row in (*rows, *feature_rows(ppd)))


def _colour_difference(first: Planes, second: Planes) -> Float[Array, "height width"]:
    difference = _hyab(first, second)
    largest = _hyab(*(_hunt_lab_of(c, difference) for c in ((0, 1, 0), (0, 0, 1))))
    knee = _KNEE * largest
    above = _KNEE_VALUE + (difference - knee) / (largest - knee) * (1 - _KNEE_VALUE)
    return jnp.where(difference < knee, difference * (_KNEE_VALUE / knee), above)


def _hunt_lab_of(light: tuple[int, ...], like: Array) -> Planes:
    red, green, blue = (jnp.asarray(share, like.dtype) for share in light)
    return hunt_lab((red, green, blue))


def _hyab(first: Planes, second: Planes) -> Float[Array, "*n"]:
    """Compressed distance: by city block in lightness, Euclidean in chroma."""
    light, a, b = (p - q for p, q in zip(first, second, strict=True))
    distance = jnp.abs(light) + safe_hypot(a, b)
    return safe_power(distance, jnp.full_like(distance, _COLOUR_EXPONENT))


def _feature_difference(
    first: tuple[Array, Array], second: tuple[Array, Array]
) -> Float[Array, "height width"]:
    edges, points = (jnp.abs(p - q) for p, q in zip(first, second, strict=True))
    larger = jnp.maximum(edges, points) / math.sqrt(2)
    return safe_power(larger, jnp.full_like(larger, _FEATURE_EXPONENT))
