"""Conditions that tables are fitted to, and conditions that they are tried on."""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from camojab._errors import check

from ._scales import even_velocities


_Ends = tuple[float | int, float | int]

# Held-out conditions: a power of two of Sobol's sequence, and the corners.
_HELD_OUT = 1024


class Conditions(NamedTuple):
    """What one polynomial is a function of, in arrays of shapes that broadcast.

    - `velocity`: [deg/s], >= 0.
    - `refresh_rate`: [Hz], > 0.
    - `log10_luminance`: [log10(cd/m^2)].
    """

    velocity: Array
    refresh_rate: Array
    log10_luminance: Array


class Domain(eqx.Module):
    """Lowest and highest condition that polynomials are good for.

    The defaults are those that the published tables were fitted to.

    - `velocity`: [deg/s], >= 0.
    - `refresh_rate`: [Hz], > 0.
    - `log10_luminance`: [log10(cd/m^2)].

    **Raises:** `ValueError` for an end out of range, or a highest below its lowest.
    """

    velocity: Float[Array, "2"]
    refresh_rate: Float[Array, "2"]
    log10_luminance: Float[Array, "2"]

    def __init__(
        self,
        *,
        velocity: ArrayLike | _Ends = (0.0, 50.0),
        refresh_rate: ArrayLike | _Ends = (30.0, 120.0),
        log10_luminance: ArrayLike | _Ends = (-1.0, 2.5),
    ):
        self.velocity = _ends(
            "velocity", velocity, lambda v: v >= 0, ">= 0 deg/s and finite"
        )
        self.refresh_rate = _ends(
            "refresh_rate", refresh_rate, lambda f: f > 0, "> 0 Hz and finite"
        )
        self.log10_luminance = _ends(
            "log10_luminance", log10_luminance, jnp.isfinite, "finite"
        )

    @property
    def luminance(self) -> Float[Array, "2"]:
        """Lowest and highest luminance. [cd/m^2]."""
        return 10.0**self.log10_luminance


def _ends(name, x, ok, rule) -> Float[Array, "2"]:
    x = jnp.asarray(x, jnp.result_type(float))
    if x.shape != (2,):
        raise ValueError(f"`{name}` must be lowest and highest, got shape {x.shape}.")
    x = check(name, x, lambda v: ok(v) & jnp.isfinite(v), rule)
    rising = lambda v: jnp.stack([v[0] <= v[1]] * 2)
    return check(name, x, rising, "lowest first, then highest")


class Grid(eqx.Module):
    """Conditions that a model is sampled at for tables, the product of three lists.

    The defaults are those of the authors' program (gfxdisp/ALSaRR d06b3e0).

    - `velocity`: [deg/s], >= 0.
    - `refresh_rate`: [Hz], > 0.
    - `log10_luminance`: [log10(cd/m^2)].
    """

    velocity: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)
    refresh_rate: tuple[float, ...] = (30.0, 45.0, 60.0, 75.0, 90.0, 105.0, 120.0)
    log10_luminance: tuple[float, ...] = (-1.0, 1.0, 2.0, 2.5)

    def __check_init__(self):
        for name in ("velocity", "refresh_rate", "log10_luminance"):
            if not len(getattr(self, name)):
                raise ValueError(f"`{name}` must be one or more, got none.")

    @classmethod
    def over(cls, domain: Domain, sizes: tuple[int, int, int] = (17, 9, 8)) -> "Grid":
        """Chebyshev's points of a domain, its ends among them.

        They are those of ln(0.5 deg/s + velocity), ln(refresh rate) and log luminance,
        so that a polynomial of high degree does not swing at the ends. Of an axis of no
        width one value is taken.

        **Raises:** `ValueError` for a size below 2.
        """
        if min(sizes) < 2:
            raise ValueError(f"`sizes` must be 2 or more of each, got {sizes}.")
        velocity, refresh_rate, level = domain_axes(domain)
        share = [_chebyshev(n) for n in sizes]
        low, high = refresh_rate
        rates = low * (high / low) ** share[1]
        return cls(
            velocity=_within(even_velocities(velocity, share[0]), velocity),
            refresh_rate=_within(rates, refresh_rate),
            log10_luminance=_within(level[0] + share[2] * (level[1] - level[0]), level),
        )

    def conditions(self) -> Conditions:
        """Every combination, as arrays `[n]`; the last list moves fastest."""
        axes = (self.velocity, self.refresh_rate, self.log10_luminance)
        mesh = np.meshgrid(*axes, indexing="ij")
        return Conditions(*(jnp.asarray(x.ravel(), float) for x in mesh))

    @property
    def domain(self) -> Domain:
        """From the lowest to the highest of each list."""
        ends = lambda x: (min(x), max(x))
        return Domain(
            velocity=ends(self.velocity),
            refresh_rate=ends(self.refresh_rate),
            log10_luminance=ends(self.log10_luminance),
        )


def held_out(domain: Domain) -> Conditions:
    """1032 conditions that fill a domain, its corners among them: always the same.

    They are even in ln(0.5 deg/s + velocity), refresh rate and log luminance: at low
    velocities the quality changes fastest. Single precision holds them exactly.

    **Source:** Sobol's sequence, without scrambling, as in `scipy.stats.qmc`.
    """
    from scipy.stats import qmc

    inside = qmc.Sobol(3, scramble=False).random(_HELD_OUT)
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), -1)
    low, high = np.array(domain_axes(domain)).T
    share = np.concatenate([inside, corners.reshape(-1, 3)])
    points = low + share * (high - low)
    points[:, 0] = even_velocities((low[0], high[0]), share[:, 0])
    # Ends are taken as they are: a tiny one is lost beside the other.
    points = np.where(share == 0, low, np.where(share == 1, high, points))
    ends = (end.astype(np.float32) for end in (low, high))
    single = np.clip(points.astype(np.float32), *ends)
    return Conditions(*(jnp.asarray(x, float) for x in single.T))


def domain_axes(domain: Domain) -> list[tuple[float, float]]:
    """Lowest and highest of velocity, refresh rate and log luminance."""
    axes = (domain.velocity, domain.refresh_rate, domain.log10_luminance)
    return [(float(low), float(high)) for low, high in map(np.asarray, axes)]


def clipped(at: Conditions, domain: Domain) -> Conditions:
    """Conditions outside of a domain moved to its edge."""
    ends = (domain.velocity, domain.refresh_rate, domain.log10_luminance)
    return Conditions(*(jnp.clip(x, *e) for x, e in zip(at, ends, strict=True)))


def scaled(x: Array, ends: Float[Array, "2"]) -> Array:
    """`x` mapped linearly from its ends to [-1, 1]; 0 where these are the same."""
    low, high = ends[0], ends[1]
    width = jnp.where(high > low, high - low, 1)
    return jnp.where(high > low, (2 * x - low - high) / width, 0)


def _chebyshev(number: int) -> np.ndarray:
    """Shares of the way between two ends, both included."""
    return 0.5 - 0.5 * np.cos(np.arange(number) * np.pi / (number - 1))


def _within(x: np.ndarray, ends: tuple[float, float]) -> tuple[float, ...]:
    """Exactly from end to end, whatever rounding did; one value where these are one."""
    inside = np.clip(x, *ends)
    inside[0], inside[-1] = ends
    return tuple(np.unique(inside).tolist())
