"""Nvidia Adaptive Shading, the content-dependent rule of Yang et al. 2019."""

import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int

from .._csf import broadcast
from .._display import Display, Viewing
from .._errors import check


# Error at a quarter over that at half the rate, for a still image (Eq. 14).
_QUARTER = 2.13


def half_rate_error_yang2019(
    luma: Float[ArrayLike, "*tiles height width"],
) -> Float[Array, "*tiles 2"]:
    r"""Error that halving the shading rate of a tile makes, along x and along y.

    $$E_{h,x} = \sqrt{\operatorname{mean}\big(\tfrac{Y(p) - Y(p - e_x)}{2}\big)^2}$$

    over the pairs of neighbours that lie within the tile, and likewise for y.

    **Arguments:** `luma`: of the final picture, rows of pixels, at least 2 x 2; a tile
    has 16 x 16. [1], finite.

    **Returns:** the two errors in the last axis. [1], >= 0. Where it is 0 its
    derivative is taken as 0.

    **Raises:** `ValueError` for a tile without neighbours or a value that is not
    finite.

    **Source:** Yang et al. 2019, "Visually Lossless Content and Motion Adaptive Shading
    in Games", Proc. ACM Comput. Graph. Interact. Tech. 2(1), doi:10.1145/3320287,
    Eq. 2. The equations are cited as the comments of GameTechDev/VALAR-API (MIT) number
    them; the constants are equal there and in NVIDIAGameWorks/nas-sample at 242ffb3
    (MIT).
    """
    y = check("luma", luma, _finite, "finite")
    if y.ndim < 2 or min(y.shape[-2:]) < 2:
        raise ValueError(f"`luma` must have 2 x 2 pixels or more, got {list(y.shape)}.")
    across = _root_mean_square(jnp.diff(y, axis=-1) / 2)
    down = _root_mean_square(jnp.diff(y, axis=-2) / 2)
    return jnp.stack([across, down], axis=-1)


def texture_error_yang2019(
    texture: Float[ArrayLike, "height width"], *, environment_luma: ArrayLike = 0.1
) -> Float[Array, "2"]:
    """Error of a whole texture at half rate relative to its threshold, for `quality`.

    The half-rate error of Eq. 2 over all texels, one to a pixel, divided by the
    threshold of Eq. 15 at sensitivity 1. This is this package's own definition: neither
    Yang et al. nor Jindal et al. 2021, who compare NAS with CaMoJAB, give the error of
    a texture, and what the latter took could not be identified from their results.

    **Arguments:**

    - `texture`: relative luminance. [1], finite.
    - `environment_luma`: l of Eq. 15. [1], > 0. 0.1 is the default of Nvidia's sample.

    **Returns:** the error along x and along y. [1], >= 0.

    **Raises:** `ValueError` as `half_rate_error_yang2019` and `threshold_yang2019`.
    """
    texture = check("texture", texture, _finite, "finite")
    least = threshold_yang2019(
        jnp.mean(texture), sensitivity=1.0, environment_luma=environment_luma
    )
    return half_rate_error_yang2019(texture) / least.astype(texture.dtype)


def half_rate_motion_yang2019(
    pixels_per_frame: ArrayLike,
) -> Float[Array, "..."]:
    r"""Factor on the half-rate error where a picture moves.

    $$b_h(v) = \Big(\frac{1}{1 + (1.05\,v)^{3.10}}\Big)^{0.35}$$

    **Arguments:** `pixels_per_frame`: speed along the axis judged. [px/frame], >= 0.

    **Returns:** factor, in (0, 1], 1 at rest. [1].

    **Raises:** `ValueError` for a speed that is negative or not finite.

    **Source:** Yang et al. 2019, Eq. 20.
    """
    v = check("pixels_per_frame", pixels_per_frame, _not_negative, _SPEED)
    return jnp.exp(-0.35 * jnp.log1p((1.05 * v) ** 3.10))


def quarter_rate_motion_yang2019(
    pixels_per_frame: ArrayLike,
) -> Float[Array, "..."]:
    r"""Factor on the half-rate error that gives the quarter-rate error in motion.

    $$b_q(v) = 2.13\,\Big(\frac{1}{1 + (0.55\,v)^{2.41}}\Big)^{0.49}$$

    It takes the place of the factor k = 2.13 of a still picture, which it is at rest.

    **Arguments, raises:** as `half_rate_motion_yang2019`.

    **Returns:** factor, in (0, 2.13]. [1].

    **Source:** Yang et al. 2019, Eq. 14 and 21.
    """
    v = check("pixels_per_frame", pixels_per_frame, _not_negative, _SPEED)
    return _QUARTER * jnp.exp(-0.49 * jnp.log1p((0.55 * v) ** 2.41))


def threshold_yang2019(
    mean_luma: ArrayLike, *, sensitivity: ArrayLike, environment_luma: ArrayLike
) -> Float[Array, "..."]:
    """Error that is just noticeable in a tile, by Weber's law.

    **Arguments:** (shapes that broadcast)

    - `mean_luma`: of the tile. [1], >= 0.
    - `sensitivity`: t, the noticeable error per luma; larger makes coarser. [1], > 0.
    - `environment_luma`: l, which keeps dark tiles from needing no error at all. [1],
      > 0.

    **Returns:** t (mean + l). [1], > 0.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Source:** Yang et al. 2019, Eq. 15.
    """
    mean, t, level = broadcast(
        check("mean_luma", mean_luma, _not_negative, "finite and >= 0"),
        check("sensitivity", sensitivity, _positive, "finite and > 0"),
        check("environment_luma", environment_luma, _positive, "finite and > 0"),
    )
    return t * (mean + level)


def rates_yang2019(
    error: Float[Array, "*tiles 2"],
    threshold: Float[Array, "*tiles"],
    pixels_per_frame: Float[Array, "*tiles 2"],
) -> Int[Array, "*tiles 2"]:
    """Coarse pixel of each tile, the coarsest whose error is not noticeable.

    On each axis 1 where the half-rate error reaches the threshold, 4 where the
    quarter-rate error is below it, and 2 in between. No hardware has 4x1 and 1x4, which
    become 2x1 and 1x2.

    **Arguments:** along x and y in the last axis,

    - `error`: half-rate error of the still picture. [1], finite and >= 0.
    - `threshold`: of each tile, both axes alike. [1], finite and > 0.
    - `pixels_per_frame`: speed. [px/frame], finite and >= 0.

    **Returns:** width and height of the coarse pixel in the last axis, each 1, 2 or 4.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Source:** Yang et al. 2019, Eq. 14 to 16 with the motion of Eq. 20 and 21.
    """
    error = check("error", error, _not_negative, "finite and >= 0")
    least = check("threshold", threshold, _positive, "finite and > 0")[..., None]
    half = half_rate_motion_yang2019(pixels_per_frame) * error
    quarter = quarter_rate_motion_yang2019(pixels_per_frame) * error
    size = jnp.where(half >= least, 1, jnp.where(quarter < least, 4, 2))
    other = size[..., ::-1]
    return jnp.where((size == 4) & (other == 1), 2, size)


def quality_yang2019(
    error: ArrayLike, rate: ArrayLike, pixels_per_frame: ArrayLike
) -> Float[Array, "..."]:
    """Quality of one axis shaded at full, half or quarter rate: minus its error.

    0 at full rate, `-error` times the motion's factor of Eq. 20 at half and of Eq. 21
    at quarter rate. Refresh rate, luminance and persistence count for nothing, but for
    the refresh rate in `pixels_per_frame`; at full rate all conditions are equal.

    **Arguments:** (shapes that broadcast)

    - `error`: half-rate error of the still picture along the axis, such as an element
      of `texture_error_yang2019`. Finite and >= 0.
    - `rate`: shading resolution along the axis. [1]; 1, 1/2 or 1/4, all that NAS knows.
    - `pixels_per_frame`: speed along the axis. [px/frame], finite and >= 0.

    **Returns:** quality in the unit of `error`, <= 0, to be scaled to JND.

    **Raises:** `ValueError` naming the argument that is out of range.

    **Source:** Yang et al. 2019, Eq. 14, 20 and 21; used for quality as Jindal et al.
    2021 (section 4.5) seem to: on the resolution data of ITU-R BT.2246 this definition
    leaves 1.19, which is what they print.
    """
    e, r, v = broadcast(
        check("error", error, _not_negative, "finite and >= 0"),
        check("rate", rate, _known_rate, "1, 1/2 or 1/4"),
        check("pixels_per_frame", pixels_per_frame, _not_negative, _SPEED),
    )
    half, quarter = half_rate_motion_yang2019(v), quarter_rate_motion_yang2019(v)
    return e * jnp.where(r == 1, 0, jnp.where(r == 0.5, -half, -quarter))


@eqx.filter_jit
def pixels_per_frame(display: Display, viewing: Viewing) -> Float[Array, "..."]:
    """Motion in the unit that NAS is stated in. [px/frame], >= 0.

    **Arguments:** shapes that broadcast; `ppd` and `refresh_rate` of `display` are
    used.

    **Returns:** velocity times ppd over the refresh rate.
    """
    v, ppd, rate = broadcast(viewing.velocity, display.ppd, display.refresh_rate)
    return v * ppd / rate


def _root_mean_square(x: Float[Array, "*n rows columns"]) -> Float[Array, "*n"]:
    mean = jnp.mean(x**2, axis=(-2, -1))
    some = mean > 0
    return jnp.where(some, jnp.sqrt(jnp.where(some, mean, 1)), 0)


_SPEED = "finite and >= 0 px/frame"


def _finite(x: Array) -> Array:
    return abs(x) < math.inf


def _positive(x: Array) -> Array:
    return (x > 0) & (x < math.inf)


def _not_negative(x: Array) -> Array:
    return (x >= 0) & (x < math.inf)


def _known_rate(x: Array) -> Array:
    return (x == 1) | (x == 0.5) | (x == 0.25)
