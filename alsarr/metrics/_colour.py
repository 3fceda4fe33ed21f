"""The colour spaces that FLIP passes through; a colour is three planes.

Logarithms and exponentials stand for powers and roots, which XLA computes several times
slower on a CPU.
"""

import functools
import operator
from collections.abc import Iterable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._picture import decoded


Planes = tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]

# Linear sRGB to XYZ, as FLIP writes it.
_XYZ = np.array(
    [
        [10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794],
        [2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897],
        [1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382],
    ]
)
_RELATIVE_XYZ = _XYZ / _XYZ.sum(axis=1, keepdims=True)
_OPPONENT = np.array([[0, 116, 0], [500, -500, 0], [0, 200, -200]]) @ _RELATIVE_XYZ
_LIGHT = np.linalg.inv(_OPPONENT)

_LUMINANCE = (0.2126, 0.7152, 0.0722)
# Of ITU-R BT.601, on the encoded picture.
_LUMA = (0.299, 0.587, 0.114)

# Where the cube root of CIE L*a*b* gives way to a straight line.
_DELTA = 6 / 29


def emitted(image: Float[Array, "height width 3"]) -> Planes:
    """Light of a display that shows an sRGB-encoded picture, as shares of white's."""
    return planes(decoded(image))


def planes(image: Float[Array, "height width 3"]) -> Planes:
    return image[..., 0], image[..., 1], image[..., 2]


def total(terms: Iterable[Array]) -> Array:
    """Sum term by term, which XLA makes one loop of."""
    return functools.reduce(operator.add, terms)


def luma(image: Float[Array, "height width 3"]) -> Float[Array, "height width"]:
    """Weighted sum of the encoded values of a picture. [1]"""
    return _weighted(planes(image), _LUMA)


def luminance(light: Planes) -> Float[Array, "*n"]:
    return _weighted(light, _LUMINANCE)


def opponent(light: Planes) -> Planes:
    """YCxCz with Y + 16 in the place of Y, which is linear in light.

    **Source:** Andersson et al. 2020, section 4.1.1.
    """
    return _mixed(light, _OPPONENT)


def shown(colour: Planes) -> Planes:
    """The light that a display can show of `opponent`'s colours."""
    red, green, blue = _mixed(colour, _LIGHT)
    return _unit(red), _unit(green), _unit(blue)


def hunt_lab(light: Planes) -> Planes:
    """CIE L*a*b* under D65, with a* and b* in proportion to L*, as Hunt found them.

    **Source:** Andersson et al. 2020, section 4.1.2.
    """
    x, y, z = (_root(plane) for plane in _mixed(light, _RELATIVE_XYZ))
    lightness = 116 * y - 16
    return lightness, 5 * lightness * (x - y), 2 * lightness * (y - z)


def _root(x: Float[Array, "*n"]) -> Float[Array, "*n"]:
    root = jnp.exp(jnp.log(jnp.maximum(x, _DELTA**3)) / 3)
    return jnp.where(x > _DELTA**3, root, x / (3 * _DELTA**2) + 4 / 29)


def _unit(plane: Float[Array, "*n"]) -> Float[Array, "*n"]:
    return jnp.clip(plane, 0.0, 1.0)


def _mixed(colour: Planes, matrix: np.ndarray) -> Planes:
    first, second, third = (_weighted(colour, tuple(row)) for row in matrix.tolist())
    return first, second, third


def _weighted(colour: Planes, weights: tuple[float, ...]) -> Float[Array, "*n"]:
    return total(weight * plane for weight, plane in zip(weights, colour, strict=True))
