"""FLIP for light without an upper end, over the exposures one may choose for it."""

import functools
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check

from ._checks import checked_light, checked_ppd, concrete, same_shape
from ._colour import luminance, Planes, planes
from ._flip import difference


# Quadratic over quadratic, highest powers first.
_CURVES = {
    "aces": ((0.9036, 0.018, 0.0), (0.8748, 0.354, 0.14)),
    "reinhard": ((0.0, 1.0, 0.0), (0.0, 1.0, 1.0)),
    "hable": ((0.231683, 0.013791, 0.0), (0.18, 0.3, 0.018)),
}
# How much of white the brightest and the median pixel are shown as.
_TARGET = 0.85


def hdr_flip(
    reference: ArrayLike,
    test: ArrayLike,
    *,
    ppd: ArrayLike,
    tone_mapper: str = "aces",
    exposures: ArrayLike | None = None,
) -> Float[Array, "height width"]:
    """The largest difference that is seen at any of several exposures.

    **Arguments:**

    - `reference`, `test`: linear light with the primaries of sRGB, shape [height,
      width, 3], in any unit. Finite and >= 0.
    - `ppd`: as for `flip`.
    - `tone_mapper`: "aces", "reinhard" or "hable".
    - `exposures`: powers of two to multiply light with, shape [n]. [stops], finite. By
      default those of `automatic_exposures`; they depend on the values of `reference`,
      so under a JAX transformation they must be given.

    **Returns:** for each pixel the largest `flip` of the tone-mapped pictures. [1], >=
    0. Differentiable in both pictures; the exposures count as constants if they are not
    given as an argument that is differentiated.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Accuracy, source:** as for `flip`, and Andersson et al. 2021, "Visualizing Errors
    in Rendered High Dynamic Range Images", Eurographics short papers,
    doi:10.2312/egs.20211015. Of the tone mappers Reinhard's acts on luminance.
    """
    mapped = _tone_mapper(tone_mapper)
    pair = checked_light("reference", reference), checked_light("test", test)
    same_shape(*pair)
    value = checked_ppd(ppd)
    if exposures is None:
        exposures = automatic_exposures(pair[0], tone_mapper=tone_mapper)
    stops = check("exposures", exposures, lambda x: jnp.isfinite(x), "finite")
    if stops.ndim != 1 or not stops.size:
        raise ValueError(
            f"`exposures` must be a list of one or more, got shape {stops.shape}."
        )
    errors = (
        difference(value, mapped, *((light, stop) for light in pair)) for stop in stops
    )
    return functools.reduce(jnp.maximum, errors)


def automatic_exposures(
    reference: ArrayLike, *, tone_mapper: str = "aces"
) -> Float[Array, " exposures"]:
    """Exposures from the one that shows the brightest pixel to that of the median.

    **Arguments:** as for `hdr_flip`; a plain array, since their number depends on it.

    **Returns:** at least two, equally spaced, about a stop apart. [stops]

    **Raises:** `ValueError` as `hdr_flip`, or for a `reference` of which more than half
    is black, whose median no exposure can show.

    **Source:** Andersson et al. 2021, section 3.
    """
    _tone_mapper(tone_mapper)
    concrete("reference", reference, "give `exposures` to `hdr_flip`")
    light = planes(checked_light("reference", reference))
    shone = np.asarray(luminance(light), float).ravel()
    middle = float(np.partition(shone, shone.size // 2)[shone.size // 2])
    if middle == 0:
        raise ValueError(
            "`reference` must have light in half its pixels or more for automatic "
            "exposures, got a median of 0: give `exposures` to `hdr_flip`."
        )
    start, stop = np.log2(_white_of(tone_mapper) / np.array([shone.max(), middle]))
    number = max(2, math.ceil(stop - start))
    return jnp.asarray(np.linspace(start, stop, number), jnp.result_type(float))


def _tone_mapper(name: str):
    if name not in _MAPPED:
        raise ValueError(
            f"`tone_mapper` must be one of {', '.join(_MAPPED)}, got {name!r}."
        )
    return _MAPPED[name]


def _white_of(tone_mapper: str) -> float:
    """The value that is shown as `_TARGET` of white."""
    above, below = (np.array(c) for c in _CURVES[tone_mapper])
    return float(np.roots(np.trim_zeros(above - _TARGET * below, "f")).real.max())


def _curve(x: Float[Array, "*n"], name: str) -> Float[Array, "*n"]:
    above, below = ((a * x + b) * x + c for a, b, c in _CURVES[name])
    return jnp.clip(above / below, 0.0, 1.0)


def _exposed(
    light: Float[Array, "height width 3"], stop: Float[Array, ""]
) -> Float[Array, "height width 3"]:
    # Far beyond white for every curve, and its square is still finite.
    return jnp.minimum(light * jnp.exp2(stop), 1e6)


def _aces(light: Float[Array, "height width 3"], stop: Float[Array, ""]) -> Planes:
    return planes(_curve(_exposed(light, stop), "aces"))


def _hable(light: Float[Array, "height width 3"], stop: Float[Array, ""]) -> Planes:
    return planes(_curve(_exposed(light, stop), "hable"))


def _reinhard(light: Float[Array, "height width 3"], stop: Float[Array, ""]) -> Planes:
    red, green, blue = planes(_exposed(light, stop))
    scale = 1 / (1 + luminance((red, green, blue)))
    red, green, blue = (jnp.minimum(p * scale, 1.0) for p in (red, green, blue))
    return red, green, blue


# Functions with names of their own, which `jit` can tell apart.
_MAPPED = {"aces": _aces, "reinhard": _reinhard, "hable": _hable}
