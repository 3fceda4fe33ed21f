"""Eq. 31 of the paper: its value, and its least squares."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from camojab._errors import check

from ._orthonormal import Orthonormal, orthonormal


def evaluate_eq31(
    coefficients: Float[Array, "*#n 10"],
    velocity: Float[Array, "*#n"],
    refresh_rate: Float[Array, "*#n"],
    log10_luminance: Float[Array, "*#n"],
) -> Float[Array, "*n"]:
    r"""The polynomial that stands for the quality of one texture, mip level and rate.

    $$q = (W_0 + W_1 v + W_2 f + W_3 v^2 + W_4 v f + W_5 f^2)
    (W_6 L^3 + W_7 L^2 + W_8 L + W_9)$$

    **Arguments:** (the shapes before the 10 broadcast; all of one dtype)

    - `coefficients`: $W_0$ to $W_9$ in the last axis.
    - `velocity`: $v$. [deg/s], >= 0.
    - `refresh_rate`: $f$. [Hz], > 0.
    - `log10_luminance`: $L$. [log10(cd/m^2)].

    **Returns:** quality. [JND]. It means something only inside the ranges that the
    coefficients were fitted to.

    **Raises:** nothing.

    **Source:** Jindal et al. (2021), ACM Trans. Graph. 40(6), Eq. 31.
    """
    w = [coefficients[..., i] for i in range(10)]
    v, f, level = velocity, refresh_rate, log10_luminance
    motion = w[0] + v * (w[1] + w[3] * v + w[4] * f) + f * (w[2] + w[5] * f)
    light = w[9] + level * (w[8] + level * (w[7] + level * w[6]))
    return motion * light


class Eq31Fit(eqx.Module, strict=True):
    """What `fit_eq31` found, and how far to trust it.

    - `coefficients`: $W_0$ to $W_9$, for velocity in deg/s, refresh rate in Hz and the
        decimal logarithm of luminance in cd/m^2. The second factor is scaled so that
        the largest of its magnitudes over the samples is +1, so the first is in JND.
    - `largest_error`, `median_error`: of the absolute errors over the samples. [JND]
    - `converged`: whether the last round changed less than rounding can explain.
    - `num_rounds`: rounds of alternation that were made.
    """

    coefficients: Float[Array, "10"]
    largest_error: Float[Array, ""]
    median_error: Float[Array, ""]
    converged: Bool[Array, ""]
    num_rounds: Int[Array, ""]


def fit_eq31(
    velocity: ArrayLike,
    refresh_rate: ArrayLike,
    log10_luminance: ArrayLike,
    quality: ArrayLike,
    *,
    max_rounds: int = 200,
) -> Eq31Fit:
    """Fit both factors of Eq. 31 together, by least squares in the quality.

    The two factors are linear in turn, so they are solved for in turn, in bases that
    are orthonormal over the samples, starting from the leading singular pair. On a
    complete grid of (velocity, refresh rate) by luminance that start is already the
    global optimum. (The authors fit the first factor at the highest luminance and the
    second at one velocity and refresh rate.) Their common scale, which the product
    leaves open, is fixed by keeping the second factor at unit length.

    `jax.vmap` over `quality` alone shares all work that does not depend on it. Where
    the samples do not determine every coefficient (one refresh rate only, say), the
    smallest ones are taken, in variables scaled to [-1, 1].

    **Arguments:** (each of shape `[n]`, finite)

    - `velocity`: [deg/s], >= 0.
    - `refresh_rate`: [Hz], > 0.
    - `log10_luminance`: [log10(cd/m^2)].
    - `quality`: what to reproduce at these conditions. [JND]. All zero gives zeros.
    - `max_rounds`: when to give up. >= 1; see `Eq31Fit.converged`.

    **Returns:** an `Eq31Fit`.

    **Raises:** `ValueError` for arrays of different length, no samples, or values that
    are not finite; the latter at run time under a JAX transformation.

    **Accuracy:** in float64 the optimum that SciPy's `least_squares` finds from many
    starts, to 1e-9 of its sum of squares; in float32 to 1e-4 of the largest quality.

    **Source:** Jindal et al. (2021), ACM Trans. Graph. 40(6), Eq. 31.
    """
    samples = {
        "velocity": velocity,
        "refresh_rate": refresh_rate,
        "log10_luminance": log10_luminance,
        "quality": quality,
    }
    shapes = [jnp.shape(x) for x in samples.values()]
    if len(set(shapes)) > 1 or len(shapes[0]) != 1 or shapes[0] == (0,):
        raise ValueError(
            "`velocity`, `refresh_rate`, `log10_luminance` and `quality` must have one "
            f"shape [n] with n > 0, got {', '.join(map(str, shapes))}."
        )
    arrays = [check(name, x, jnp.isfinite, "finite") for name, x in samples.items()]
    dtype = arrays[-1].dtype
    return _fit(*(x.astype(dtype) for x in arrays), max_rounds=max_rounds)


@eqx.filter_jit
def _fit(
    velocity: Float[Array, " n"],
    refresh_rate: Float[Array, " n"],
    log10_luminance: Float[Array, " n"],
    quality: Float[Array, " n"],
    *,
    max_rounds: int,
) -> Eq31Fit:
    factors = Factors.over(velocity, refresh_rate, log10_luminance)
    size = jnp.max(jnp.abs(quality))
    size = jnp.where(size > 0, size, 1)
    motion, light = factors.motion, factors.light
    a, b, converged, rounds = _alternate(motion, light, quality / size, max_rounds)
    w = factors.in_plain_units(a * size, b)
    error = jnp.abs(
        evaluate_eq31(w[None], velocity, refresh_rate, log10_luminance) - quality
    )
    return Eq31Fit(w, jnp.max(error), jnp.median(error), converged, rounds)


class Factors(eqx.Module, strict=True):
    """Both factors of Eq. 31 in bases that are orthonormal over some samples."""

    motion: Orthonormal
    light: Orthonormal
    scales: tuple[Float[Array, "2"], ...]

    @classmethod
    def over(
        cls,
        velocity: Float[Array, " n"],
        refresh_rate: Float[Array, " n"],
        log10_luminance: Float[Array, " n"],
    ) -> "Factors":
        scales = tuple(map(_centre_and_half, (velocity, refresh_rate, log10_luminance)))
        monomials = _monomials(velocity, refresh_rate, log10_luminance, scales)
        motion, light = map(orthonormal, monomials)
        return cls(motion, light, scales)

    def values(
        self,
        velocity: Float[Array, " n"],
        refresh_rate: Float[Array, " n"],
        log10_luminance: Float[Array, " n"],
    ) -> tuple[Float[Array, "n 6"], Float[Array, "n 4"]]:
        """The bases of both factors at any conditions."""
        motion, light = _monomials(velocity, refresh_rate, log10_luminance, self.scales)
        return motion @ self.motion.to_monomials, light @ self.light.to_monomials

    def in_plain_units(
        self, a: Float[Array, "6"], b: Float[Array, "4"]
    ) -> Float[Array, "10"]:
        """$W_0$ to $W_9$; the second factor's largest value over the samples is 1."""
        v, f, level = self.scales
        w_motion = _motion_in_plain_units(self.motion.to_monomials @ a, v, f)
        w_light = _light_in_plain_units(self.light.to_monomials @ b, level)
        factor = self.light.values @ b
        peak = factor[jnp.argmax(jnp.abs(factor))]
        some = jnp.any(a != 0) & (peak != 0)
        peak = jnp.where(some, peak, 1)
        return jnp.concatenate([w_motion * peak, jnp.where(some, w_light / peak, 0)])


def fit_two_steps(
    velocity: Float[Array, " n"],
    refresh_rate: Float[Array, " n"],
    log10_luminance: Float[Array, " n"],
    quality: Float[Array, "tables n"],
) -> Float[Array, "tables 10"]:
    """The authors' way to fit Eq. 31: one factor after the other.

    The first is fitted at the highest luminance alone; the second, a share of the
    first, at the lowest velocity and the refresh rate nearest to 105 Hz alone.

    **Source:** ALSaRR/fit_polynomials of gfxdisp/ALSaRR at d06b3e0.
    """
    v, f, level = map(np.asarray, (velocity, refresh_rate, log10_luminance))
    bright = level == level.max()
    middle = f[np.abs(f - 105.0).argmin()]
    still = (v == v.min()) & (f == middle)
    scales = tuple(map(_centre_and_half, (velocity, refresh_rate, log10_luminance)))
    motion, light = _monomials(velocity, refresh_rate, log10_luminance, scales)
    surface, share = orthonormal(motion[bright]), orthonormal(light[still])

    def one(q: Float[Array, " n"]) -> Float[Array, "10"]:
        a = surface.to_monomials @ (surface.values.T @ q[bright])
        at_rest = (motion[still] @ a)[0]
        some = at_rest != 0
        ratio = jnp.where(some, q[still] / jnp.where(some, at_rest, 1), 0)
        b = share.to_monomials @ (share.values.T @ ratio)
        plain = _motion_in_plain_units(a, scales[0], scales[1])
        return jnp.concatenate([plain, _light_in_plain_units(b, scales[2])])

    return jax.vmap(one)(quality)


def _monomials(
    velocity: Float[Array, " n"],
    refresh_rate: Float[Array, " n"],
    log10_luminance: Float[Array, " n"],
    scales: tuple[Float[Array, "2"], ...],
) -> tuple[Float[Array, "n 6"], Float[Array, "n 4"]]:
    """Of variables scaled to [-1, 1]."""
    axes = zip((velocity, refresh_rate, log10_luminance), scales, strict=True)
    v, f, level = ((x - scale[0]) / scale[1] for x, scale in axes)
    one = jnp.ones_like(v)
    motion = jnp.stack([one, v, f, v * v, v * f, f * f], axis=1)
    return motion, jnp.stack([level**3, level**2, level, one], axis=1)


def _alternate(
    motion: Orthonormal, light: Orthonormal, target: Float[Array, " n"], max_rounds: int
) -> tuple[Float[Array, "6"], Float[Array, "4"], Bool[Array, ""], Int[Array, ""]]:
    """Coefficients of the two factors whose product comes closest to `target`."""
    pairs = motion.values[:, :, None] * light.values[:, None, :]
    gram = jnp.einsum("nij,nkl->ijkl", pairs, pairs)
    moments = jnp.einsum("nij,n->ij", pairs, target)
    tolerance = 8 * jnp.finfo(target.dtype).eps

    def one_round(state):
        a, b, _, rounds = state
        new_a = _solve(jnp.einsum("ijkl,j,l->ik", gram, b, b), moments @ b, motion)
        new_b = _solve(
            jnp.einsum("ijkl,i,k->jl", gram, new_a, new_a), moments.T @ new_a, light
        )
        length = jnp.linalg.norm(new_b)
        length = jnp.where(length > 0, length, 1)
        new_a, new_b = new_a * length, new_b / length
        moved = jnp.max(jnp.abs(new_a - a)) > tolerance * jnp.max(jnp.abs(new_a))
        return new_a, new_b, moved, rounds + 1

    _, _, leading = jnp.linalg.svd(moments, full_matrices=False)
    start = (
        jnp.zeros_like(moments[:, 0]),
        leading[0],
        jnp.array(True),
        jnp.zeros((), int),
    )
    going = lambda state: state[2] & (state[3] < max_rounds)
    a, b, moved, rounds = jax.lax.while_loop(going, one_round, start)
    return a, b, ~moved, rounds


def _solve(
    normal: Float[Array, "terms terms"],
    right: Float[Array, " terms"],
    basis: Orthonormal,
) -> Float[Array, " terms"]:
    """Normal equations, with 0 for what the samples do not determine."""
    scale = jnp.trace(normal)
    ridge = jnp.where(scale > 0, scale * jnp.finfo(normal.dtype).eps, 1)
    ridge = ridge + jnp.where(basis.determined > 0, 0, scale)
    return jnp.linalg.solve(normal + jnp.diag(ridge), right)


def _centre_and_half(x: Float[Array, " n"]) -> Float[Array, "2"]:
    """What maps `x` onto [-1, 1]: its centre and half its width."""
    low, high = jnp.min(x), jnp.max(x)
    half = (high - low) / 2
    return jnp.stack([(low + high) / 2, jnp.where(half > 0, half, 1)])


def _motion_in_plain_units(
    a: Float[Array, "6"], v_scale: Float[Array, "2"], f_scale: Float[Array, "2"]
) -> Float[Array, "6"]:
    (cv, hv), (cf, hf) = v_scale, f_scale
    w3, w4, w5 = a[3] / hv**2, a[4] / (hv * hf), a[5] / hf**2
    w1, w2 = a[1] / hv, a[2] / hf
    constant = a[0] - w1 * cv - w2 * cf + w3 * cv**2 + w4 * cv * cf + w5 * cf**2
    slope_v = w1 - 2 * w3 * cv - w4 * cf
    slope_f = w2 - 2 * w5 * cf - w4 * cv
    return jnp.stack([constant, slope_v, slope_f, w3, w4, w5])


def _light_in_plain_units(
    b: Float[Array, "4"], scale: Float[Array, "2"]
) -> Float[Array, "4"]:
    c, h = scale
    b3, b2, b1 = b[0] / h**3, b[1] / h**2, b[2] / h
    return jnp.stack(
        [
            b3,
            b2 - 3 * b3 * c,
            b1 - 2 * b2 * c + 3 * b3 * c**2,
            b[3] - b1 * c + b2 * c**2 - b3 * c**3,
        ]
    )
