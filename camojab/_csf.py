"""Contrast sensitivity, named by author and year.

Everything is formed as a logarithm: products of very large and very small factors stay
finite in single precision, and a power of the sensitivity costs one multiplication.
"""

import math
from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from ._errors import check


# Cone responses (LMS) to 1 cd/m^2 of D65, and the luminance direction in LMS.
_XYZ_TO_LMS = np.array(
    [
        [0.187596268556126, 0.585168649077728, -0.026384263306304],
        [-0.133397430663221, 0.405505777260049, 0.034502127690364],
        [0.000244379021663, -0.000542995890619, 0.019406849066323],
    ]
)
_BACKGROUND = _XYZ_TO_LMS @ np.array([0.9504, 1.0, 1.0888])
_CONTRAST = np.array([0.698, 0.302, 0.019613]) / _BACKGROUND
_MECHANISMS = np.array(
    [
        [1.0, 0.210461, 6.43059e-7],
        [1.0, -0.936788, 0.00631996],
        [-0.00135758, -1.13497, 1.0],
    ]
)
_RESPONSE = np.abs(_MECHANISMS @ _CONTRAST)
_NORM = math.sqrt(3) / float(np.linalg.norm(_CONTRAST))
_AREA = math.pi / 25  # [deg^2]: a stimulus of radius 1/5 deg, as in Eq. 19


@dataclass(frozen=True)
class _Mechanism:
    """One row of the spatio-chromatic model: the numbers as published."""

    sensitivity: tuple[float, ...]
    peak_frequency: tuple[float, ...]
    bandwidth: float
    gamma: float
    critical_area: float
    response: float
    low_pass: bool

    def log_response(
        self, log_frequency: Float[Array, "*n"], luminance: Float[Array, "*n"]
    ) -> Float[Array, "*n"]:
        """Natural logarithm of this mechanism's response at detection threshold."""
        log_peak = _log_luminance_dependence(self.peak_frequency, luminance)
        log_ratio = log_frequency - log_peak
        if self.low_pass:
            log_ratio = jnp.maximum(log_ratio, 0.0)
        # The parabola is published in decimal logarithms.
        fall = log_ratio**2 / (math.log(10) * 0.5 * 2**self.bandwidth)
        return (
            math.log(self.response)
            + _log_luminance_dependence(self.sensitivity, luminance)
            - fall
            + self._log_spatial_summation(log_frequency)
        )

    def _log_spatial_summation(self, log_frequency: Float[Array, "*n"]) -> Array:
        """Logarithm of sqrt(A^g rho^2 / (k + A^g rho^2)) without overflow."""
        half = 0.5 * (
            math.log(self.critical_area + 0.65 * _AREA) - self.gamma * math.log(_AREA)
        )
        return -0.5 * jnp.logaddexp(2.0 * (half - log_frequency), 0.0)


_ACHROMATIC = _Mechanism(
    sensitivity=(346170.0, 5.64888, 0.319293, 1.8663e6, 7.57549e-5),
    peak_frequency=(2.12365, 2289.53, 0.186249),
    bandwidth=1.09076,
    gamma=1.11387,
    critical_area=52.3184,
    response=float(_RESPONSE[0]),
    low_pass=False,
)
_RED_GREEN = _Mechanism(
    sensitivity=(439.738, 22.4193, 0.479041),
    peak_frequency=(0.119941,),
    bandwidth=2.70798,
    gamma=1.73378,
    critical_area=1.25741,
    response=float(_RESPONSE[1]),
    low_pass=True,
)
_YELLOW_VIOLET = _Mechanism(
    sensitivity=(11867.2, 253.395, 0.33456),
    peak_frequency=(7.74728e-8,),
    bandwidth=5.33398,
    gamma=1.47414,
    critical_area=0.28267,
    response=float(_RESPONSE[2]),
    low_pass=True,
)


_MECHANISM = (_ACHROMATIC, _RED_GREEN, _YELLOW_VIOLET)


def _log_luminance_dependence(
    p: tuple[float, ...], luminance: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Logarithm of p1, p1 (1 + p2/L)^-p3, or that times 1 - (1 + p4/L)^-p5."""
    value = jnp.full_like(luminance, math.log(p[0]))
    if len(p) > 1:
        value = value - p[2] * jnp.log1p(p[1] / luminance)
    if len(p) > 3:
        value = value + jnp.log(-jnp.expm1(-p[4] * jnp.log1p(p[3] / luminance)))
    return value


LogGains = tuple[ArrayLike, ...]

# Logarithms of the factors on the achromatic, red-green and yellow-violet mechanisms,
# and on the response to flicker: the published sensitivity.
PUBLISHED: LogGains = (0.0, 0.0, 0.0, 0.0)


def _log_sensitivity_wuerger2020(
    log_frequency: Float[Array, "*n"], luminance: Float[Array, "*n"], gains: LogGains
) -> Float[Array, "*n"]:
    """Spatio-chromatic sensitivity to a luminance grating on D65, steady."""
    adapting = luminance * float(_BACKGROUND[0] + _BACKGROUND[1])
    a, b, c = (
        2.0 * (mechanism.log_response(log_frequency, adapting) + gain)
        for mechanism, gain in zip(_MECHANISM, gains[:3], strict=True)
    )
    return math.log(_NORM) + 0.5 * jnp.logaddexp(jnp.logaddexp(a, b), c)


def _log_sensitivity_laird2006(
    frequency: Float[Array, "*n"], velocity: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Spatio-velocity sensitivity, at a retinal velocity of at least 0.3 deg/s."""
    c0, c1, c2 = 0.6329, 0.8404, 0.7986
    v = c2 * velocity
    k = 6.1 + 7.3 * jnp.abs(jnp.log10(v / 3.0)) ** 3
    return (
        jnp.log(k)
        + math.log(c0 * c1)
        + jnp.log(v)
        + 2.0 * jnp.log(2.0 * math.pi * c1 * frequency)
        - 4.0 * math.pi * c1 / 45.9 * frequency * (v + 2.0)
    )


def log_sensitivity(
    frequency: Float[Array, "*n"],
    temporal_frequency: Float[Array, "*n"],
    luminance: Float[Array, "*n"],
    gains: LogGains = PUBLISHED,
) -> Float[Array, "*n"]:
    """Natural logarithm of `sensitivity` for spatial frequencies > 0, unchecked."""
    velocity = jnp.maximum(temporal_frequency / frequency, 0.3)
    moving = _log_sensitivity_laird2006(frequency, velocity)
    still = _log_sensitivity_laird2006(frequency, jnp.full_like(frequency, 0.3))
    return (
        _log_sensitivity_wuerger2020(jnp.log(frequency), luminance, gains)
        + jnp.where(temporal_frequency > 0, gains[3], 0.0)
        + moving
        - jnp.log(jnp.exp(still) + 1e-5)
    )


def sensitivity(
    spatial_frequency: ArrayLike,
    temporal_frequency: ArrayLike,
    luminance: ArrayLike,
) -> Float[Array, "..."]:
    """Contrast sensitivity of the average observer, as the released model uses it.

    The spatio-chromatic sensitivity to a luminance grating of radius 1/5 deg on a D65
    background, times the ratio of a spatio-velocity sensitivity at `temporal_frequency`
    to the one at rest.

    **Arguments:** (any shapes that broadcast together)

    - `spatial_frequency`: [cycles/deg], >= 0.
    - `temporal_frequency`: [Hz], >= 0.
    - `luminance`: adaptation luminance. [cd/m^2], > 0.

    **Returns:** reciprocal of the threshold contrast, in the broadcast shape. [1]. At
    spatial frequency 0 it is 0 for a steady pattern and 1 for a flickering one, as in
    the released program.

    **Raises:** an error naming the argument if a value is out of range.

    **Accuracy:** relative error below 1e-10 in double and 1e-4 in single precision
    against the authors' program (`tests/test_csf.py`).

    **Source:** Wuerger et al. 2020, J. Vis. 20(4):23 (spatio-chromatic part); Daly 1998
    as calibrated by Laird et al. 2006 (spatio-velocity part); combined as in the
    program released with Jindal et al. 2021. The paper itself names the function of
    Mantiuk et al. 2021 instead.

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from camojab import sensitivity
    >>> rho = jnp.array([1.0, 4.0, 16.0])  # [cycles/deg]
    >>> print(np.asarray(sensitivity(rho, 0.0, 100.0)).round(1))
    [13.4 28.9 11.1]
    """
    rho = check(
        "spatial_frequency",
        spatial_frequency,
        lambda x: (x >= 0) & (x < math.inf),
        "finite and >= 0 cycles/deg",
    )
    f = check(
        "temporal_frequency",
        temporal_frequency,
        lambda x: (x >= 0) & (x < math.inf),
        "finite and >= 0 Hz",
    )
    level = check(
        "luminance",
        luminance,
        lambda x: (x > 0) & (x < math.inf),
        "finite and > 0 cd/m^2",
    )
    return _sensitivity(*broadcast(rho, f, level))


@eqx.filter_jit
def _sensitivity(
    rho: Float[Array, "*n"], f: Float[Array, "*n"], level: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    some = rho > 0
    value = jnp.exp(log_sensitivity(jnp.where(some, rho, 1.0), f, level))
    return jnp.where(some, value, jnp.where(f > 0, 1.0, 0.0))


def broadcast(*arrays: Float[Array, "..."]) -> tuple[Float[Array, "..."], ...]:
    """Arrays of one dtype and shape, whatever JAX's rank promotion is set to."""
    try:
        shape = np.broadcast_shapes(*(a.shape for a in arrays))
    except ValueError as error:
        shapes = [a.shape for a in arrays]
        raise ValueError(
            f"the shapes of the arguments must broadcast together, got {shapes}."
        ) from error
    dtype = jnp.result_type(*arrays)
    return tuple(jnp.broadcast_to(a.astype(dtype), shape) for a in arrays)
