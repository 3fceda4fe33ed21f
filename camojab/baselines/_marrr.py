"""MARRR, the content-independent model of Denes et al. 2020."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from .._csf import broadcast
from .._display import Display, Shading, Viewing
from .._errors import check


# The judder's frequency may not fall below the peak of the sensitivity on this grid.
_PEAK_GRID = np.arange(1.0, 51.0)  # [cycles/deg]


class Denes2020(eqx.Module):
    """Constants of MARRR. Scalars, but for `frequencies`.

    **Arguments:**

    - `pa`, `pb`: width of the pursuit blur per velocity [s] and at rest [deg]; Eq. 5.
    - `frequencies`: at which blur is judged. [cycles/deg], > 0; Eq. 14.
    - `blur_threshold`, `blur_exponent`: m_t,b and beta_b of Eq. 14. [1], > 0.
    - `parallel`, `orthogonal`: weights of the sharpness along and across the motion,
      w_P and w_O of Eq. 3. [JND].
    - `judder_threshold`, `judder_exponent`: m_t,j and beta_j of Eq. 17. [1], > 0.
    - `judder`: weight w_J of the judder energy, its sign included. [JND]. Negative
      where judder lowers quality.

    **Raises:** `ValueError` if a constant is out of range.

    **Source:** Denes et al. 2020, ACM Trans. Graph. 39(4),
    doi:10.1145/3386569.3392411, Tables 1 to 3.
    """

    pa: Float[Array, ""]
    pb: Float[Array, ""]
    frequencies: Float[Array, " frequencies"]
    blur_threshold: Float[Array, ""]
    blur_exponent: Float[Array, ""]
    parallel: Float[Array, ""]
    orthogonal: Float[Array, ""]
    judder_threshold: Float[Array, ""]
    judder_exponent: Float[Array, ""]
    judder: Float[Array, ""]

    def __init__(
        self,
        *,
        pa: ArrayLike,
        pb: ArrayLike,
        frequencies: ArrayLike,
        judder_threshold: ArrayLike,
        judder: ArrayLike,
        blur_threshold: ArrayLike = 383.5854418393431,
        blur_exponent: ArrayLike = 1.83564239998305,
        parallel: ArrayLike = 1.47281929556791,
        orthogonal: ArrayLike = 1.47281929556791,
        judder_exponent: ArrayLike = 2.574657335762098,
    ):
        self.pa = check("pa", pa, _not_negative, "finite and >= 0 s")
        self.pb = check("pb", pb, _not_negative, "finite and >= 0 deg")
        self.frequencies = check(
            "frequencies", frequencies, _positive, "finite and > 0 cycles/deg"
        )
        for name, value in (
            ("blur_threshold", blur_threshold),
            ("blur_exponent", blur_exponent),
            ("judder_threshold", judder_threshold),
            ("judder_exponent", judder_exponent),
        ):
            setattr(self, name, check(name, value, _positive, "finite and > 0"))
        for name, value in (
            ("parallel", parallel),
            ("orthogonal", orthogonal),
            ("judder", judder),
        ):
            setattr(self, name, check(name, value, _finite, "finite [JND]"))

    @classmethod
    def released(cls, *, predictable: bool = True) -> "Denes2020":
        """Constants of the program released with the paper: those to predict with.

        **Arguments:** `predictable`: whether the eye can foresee the motion. The
        unpredictable set has wider pursuit blur and a lower judder threshold.

        **Source:** `predict_quality_difference.m` of gfxdisp/motion_quality_20 at
        c244ea6 (MIT).
        """
        pa, pb = (0.001528, 0.072419) if predictable else (0.004517, 0.160428)
        return cls(
            pa=pa,
            pb=pb,
            frequencies=2.0 ** np.arange(-2, 7),
            judder_threshold=_judder_threshold(predictable),
            judder=-2.21867722216986,
        )

    @classmethod
    def printed(cls, *, predictable: bool = True) -> "Denes2020":
        """Constants as the paper prints them, which differ from `released` thrice.

        `pa` and `pb` are those of Table 1 (the predictable pair is also CaMoJAB's); the
        frequencies begin at 1 cycle/deg, not 1/4; and Eq. 18 is taken by the letter,
        with which judder *raises* quality. All other constants agree.

        **Arguments:** as `released`.

        **Source:** Denes et al. 2020, Tables 1 to 3, Eq. 14 and 18.
        """
        pa, pb = (0.001648, 0.079818) if predictable else (0.004978, 0.176820)
        return cls(
            pa=pa,
            pb=pb,
            frequencies=2.0 ** np.arange(7),
            judder_threshold=_judder_threshold(predictable),
            judder=2.21867722216986,
        )


def _judder_threshold(predictable: bool) -> float:
    return 218.712005825575 if predictable else 165.7790637102406


class MotionQuality(eqx.Module):
    """What sharpness and judder add to the quality, in the conditions' shape. [JND].

    - `parallel`, `orthogonal`: sharpness along and across the motion, >= 0 for the
      published constants.
    - `judder`: <= 0 for the released constants.

    Only differences between conditions have a meaning.

    **Source:** Denes et al. 2020, Eq. 3.
    """

    parallel: Float[Array, "..."]
    orthogonal: Float[Array, "..."]
    judder: Float[Array, "..."]


def quality_denes2020(
    display: Display,
    viewing: Viewing,
    shading: Shading | None = None,
    constants: Denes2020 | None = None,
) -> Float[Array, "..."]:
    """Quality of motion according to MARRR, whatever the content. [JND].

    **Arguments, returns, raises, source:** as `quality_terms_denes2020`, whose three
    terms are added. The difference of two conditions is Eq. 3 of Denes et al. 2020.

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from camojab import Display, Viewing
    >>> from camojab.baselines import quality_denes2020
    >>> display = Display(ppd=60, refresh_rate=jnp.array([60.0, 120.0]), luminance=100)
    >>> print(np.asarray(quality_denes2020(display, Viewing(10.0))).round(2))
    [15.37 17.77]
    """
    terms = quality_terms_denes2020(display, viewing, shading, constants)
    return terms.parallel + terms.orthogonal + terms.judder


def quality_terms_denes2020(
    display: Display,
    viewing: Viewing,
    shading: Shading | None = None,
    constants: Denes2020 | None = None,
) -> MotionQuality:
    r"""The three terms of MARRR for a moving object that the eye follows.

    With velocity $v$, refresh rate $f$, persistence $p$ and resolution $R$, blur is the
    product of Gaussians of standard deviation

    $$\sigma_D = \frac{p v}{\pi f},\quad \sigma_E = \frac{p (p_a v + p_b)}{\pi},\quad
    \sigma_R = \frac{\sqrt 2}{\pi R},$$

    all three along the motion and $\sigma_R$ alone across it. The sharpness left is
    $\sum_\omega (e^{-2\pi^2\omega^2\sigma^2} S(\omega) / m_{t,b})^{\beta_b}$ with the
    sensitivity of Barten 2004 at 100 cd/m^2. The judder's energy is
    $(S(\rho, f) / m_{t,j})^{\beta_j}$ with $\rho = f/v$, not below the frequency where
    the spatio-velocity sensitivity of Laird et al. 2006 peaks at $f$.

    **Arguments:** (shapes that broadcast together)

    - `display`: `ppd`, `refresh_rate` and `persistence` are used, `luminance` is not:
      the constants hold for 100 cd/m^2.
    - `viewing`: `velocity`; below 0.001 deg/s it counts as 0.001.
    - `shading`: `rate_x` and `rate_y` reduce the resolution along and across the
      motion; the model was calibrated with both reduced alike, by bilinear filtering.
      `mip_level` is not used. Full resolution if left out.
    - `constants`: `Denes2020.released()` if left out.

    **Returns:** the terms in the broadcast shape. [JND].

    **Raises:** `ValueError` if the shapes do not broadcast.

    **Accuracy:** differences of quality, up to 20 JND, agree with the authors' program
    to 1e-12 JND in double and 3e-5 JND in single precision
    (`tests/baselines/test_baselines_marrr.py`).
    The peak is found on whole cycles/deg from 1 to 50, as in that program, so the
    judder jumps a little with the refresh rate and its derivative leaves that out.

    **Source:** Denes et al. 2020, Eq. 3 to 18. That persistence scales both widths, the
    lower limit of $\rho$ and the sign of the judder are those of the released program.
    """
    shading = shading or Shading()
    fields = broadcast(
        viewing.velocity,
        display.refresh_rate,
        display.persistence,
        display.ppd,
        shading.rate_x,
        shading.rate_y,
    )
    same = lambda x: x.astype(fields[0].dtype)
    return _terms(jax.tree.map(same, constants or Denes2020.released()), *fields)


@eqx.filter_jit
def _terms(
    c: Denes2020,
    velocity: Float[Array, "*n"],
    refresh_rate: Float[Array, "*n"],
    persistence: Float[Array, "*n"],
    ppd: Float[Array, "*n"],
    rate_x: Float[Array, "*n"],
    rate_y: Float[Array, "*n"],
) -> MotionQuality:
    hold = persistence * velocity / refresh_rate
    pursuit = persistence * (c.pa * velocity + c.pb)
    # Widths of Eq. 4 to 6, squared; Eq. 7 divides all of them by pi.
    eye = hold**2 + pursuit**2
    along, across = 2.0 / (ppd * rate_x) ** 2, 2.0 / (ppd * rate_y) ** 2
    return MotionQuality(
        c.parallel * _sharpness(eye + along, c),
        c.orthogonal * _sharpness(across, c),
        c.judder * _judder_energy(velocity, refresh_rate, c),
    )


def _sharpness(width_squared: Float[Array, "*n"], c: Denes2020) -> Float[Array, "*n"]:
    """Eq. 12 to 14, a sum over frequencies; logarithms cannot underflow to 0^beta."""
    log_csf = _log_sensitivity_barten2004(c.frequencies) - jnp.log(c.blur_threshold)
    wide = width_squared[..., None]
    shape = (*width_squared.shape, c.frequencies.size)
    log_blur = -2.0 * jnp.broadcast_to(c.frequencies**2, shape) * wide
    return jnp.sum(
        jnp.exp(c.blur_exponent * (jnp.broadcast_to(log_csf, shape) + log_blur)), -1
    )


def _judder_energy(
    velocity: Float[Array, "*n"], refresh_rate: Float[Array, "*n"], c: Denes2020
) -> Float[Array, "*n"]:
    """Eq. 16 and 17."""
    grid = jnp.asarray(_PEAK_GRID, refresh_rate.dtype)
    every = (*refresh_rate.shape, grid.size)
    at_rate = jnp.broadcast_to(refresh_rate[..., None], every)
    on_grid = _log_sensitivity_laird2006(jnp.broadcast_to(grid, every), at_rate)
    peak = grid[jnp.argmax(on_grid, axis=-1)]
    rho = jnp.maximum(refresh_rate / jnp.maximum(velocity, 0.001), peak)
    log = _log_sensitivity_laird2006(rho, refresh_rate) - jnp.log(c.judder_threshold)
    return jnp.exp(c.judder_exponent * log)


def _log_sensitivity_barten2004(u: Float[Array, " n"]) -> Float[Array, " n"]:
    """Barten 2004, doi:10.1117/12.537476, at 100 cd/m^2 in a field of 10 deg."""
    luminance, field = 100.0, 10.0
    falling = 0.0016 * (1 + 100 / luminance) ** 0.08 * u**2
    size = 1 + 144 / field**2 + 0.64 * u**2
    noise = 63 / luminance**0.83 - 1 / jnp.expm1(-0.02 * u**2)
    return math.log(5200.0) - falling - 0.5 * jnp.log(size * noise)


def _log_sensitivity_laird2006(
    frequency: Float[Array, "*n"], temporal_frequency: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Kelly's form with the constants of Laird et al. 2006 and all c_i = 1."""
    v = jnp.maximum(temporal_frequency / frequency, 0.01)
    k = 6.1 + 7.3 * jnp.abs(jnp.log10(v / 3.0)) ** 3
    fall = 2.0 / 45.9 * frequency * (v + 2.0)
    return jnp.log(k) + jnp.log(v) + 2.0 * jnp.log(frequency) - fall


def _positive(x: Array) -> Array:
    return (x > 0) & (x < math.inf)


def _not_negative(x: Array) -> Array:
    return (x >= 0) & (x < math.inf)


def _finite(x: Array) -> Array:
    return abs(x) < math.inf
