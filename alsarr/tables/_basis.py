"""The forms that a quality can take, behind one class."""

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._constrained import fit_constrained_linear, fit_constrained_product
from ._domain import Conditions, Domain, scaled
from ._eq31 import evaluate_eq31, Factors, fit_eq31, fit_two_steps
from ._orthonormal import orthonormal
from ._rate_order import RateOrder
from ._scales import log_travel, log_travel_beyond


class AbstractBasis(eqx.Module, strict=True):
    """A family of functions of velocity, refresh rate and log luminance."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What files call it."""

    @property
    @abstractmethod
    def num_coefficients(self) -> int:
        """Numbers that one member of the family takes."""

    @abstractmethod
    def evaluate(
        self, coefficients: Float[Array, "... c"], at: Conditions, domain: Domain
    ) -> Float[Array, "..."]:
        """Quality at conditions whose shapes broadcast with what is before the `c`.

        [JND]. It means something only within the domain.
        """

    @abstractmethod
    def fit(
        self, at: Conditions, quality: Float[Array, "tables n"], domain: Domain
    ) -> Float[Array, "tables c"]:
        """Least squares in the quality, one table beside the other. [JND]."""

    @abstractmethod
    def fit_ordered(
        self,
        at: Conditions,
        quality: Float[Array, "tables rates n"],
        domain: Domain,
        dense: Conditions,
        order: RateOrder,
    ) -> Float[Array, "tables rates c"]:
        """Least squares with the rates in `order` at all `dense` conditions."""

    @abstractmethod
    def constant(self, value: float) -> Float[Array, " c"]:
        """The member that is `value` everywhere. [JND]."""

    @abstractmethod
    def formula(self) -> str:
        """How a reader of a file evaluates it, in one line."""

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Name and settings, as files have them."""


class _AbstractEq31(AbstractBasis, strict=True):
    """Ten coefficients: a quadratic of motion times a cubic of log luminance."""

    @property
    def num_coefficients(self) -> int:
        return 10

    @abstractmethod
    def motion(self, velocity: Array, refresh_rate: Array) -> Array:
        """The velocity as the quadratic has it."""

    def _axes(self, at: Conditions) -> tuple[Array, Array, Array]:
        motion = self.motion(at.velocity, at.refresh_rate)
        return motion, at.refresh_rate, at.log10_luminance

    def evaluate(
        self, coefficients: Float[Array, "... c"], at: Conditions, domain: Domain
    ) -> Float[Array, "..."]:
        """See `AbstractBasis.evaluate`. The domain is not looked at."""
        del domain
        return evaluate_eq31(coefficients, *self._axes(at))

    def fit_ordered(
        self,
        at: Conditions,
        quality: Float[Array, "tables rates n"],
        domain: Domain,
        dense: Conditions,
        order: RateOrder,
    ) -> Float[Array, "tables rates c"]:
        """See `AbstractBasis.fit_ordered`."""
        del domain
        factors = Factors.over(*self._axes(at))
        sampled = factors.values(*self._axes(at))
        everywhere = factors.values(*self._axes(dense))
        found = fit_constrained_product(
            *sampled, quality, *everywhere, order.pairs, order.margin
        )
        return jax.vmap(jax.vmap(factors.in_plain_units))(*found)

    def constant(self, value: float) -> Float[Array, " c"]:
        """See `AbstractBasis.constant`."""
        return jnp.zeros(10).at[0].set(value).at[9].set(1.0)


class Eq31(_AbstractEq31, strict=True):
    """Eq. 31 as published: ten coefficients in plain units.

    **Arguments:**

    - `method`: `"joint"`, both factors together by least squares in the quality; or
      `"two-step"`, the authors': the first factor at the highest luminance alone, then
      the second at the lowest velocity and the refresh rate nearest to 105 Hz alone.

    **Source:** Jindal et al. (2021), ACM Trans. Graph. 40(6), Eq. 31;
    ALSaRR/fit_polynomials of gfxdisp/ALSaRR at d06b3e0.
    """

    method: Literal["joint", "two-step"] = eqx.field(default="joint", static=True)

    @property
    def name(self) -> str:
        """See `AbstractBasis.name`."""
        return "eq31"

    def __check_init__(self):
        if self.method not in ("joint", "two-step"):
            raise ValueError(
                f"`method` must be joint or two-step, got {self.method!r}."
            )

    def motion(self, velocity: Array, refresh_rate: Array) -> Array:
        """As it is. [deg/s]."""
        del refresh_rate
        return velocity

    def fit(
        self, at: Conditions, quality: Float[Array, "tables n"], domain: Domain
    ) -> Float[Array, "tables c"]:
        """See `AbstractBasis.fit`."""
        del domain
        if self.method == "two-step":
            return fit_two_steps(*at, quality)
        return _fit_eq31(*at, quality)

    def formula(self) -> str:
        """See `AbstractBasis.formula`."""
        return _EQ31

    def describe(self) -> dict[str, Any]:
        """See `AbstractBasis.describe`."""
        return {"name": self.name, "method": self.method}


class Eq31LogTravel(_AbstractEq31, strict=True):
    """Eq. 31 with the travel in one frame, on a logarithmic scale, for the velocity.

    Ten coefficients, for ln(1 + velocity / refresh rate / 0.05 deg).
    """

    @property
    def name(self) -> str:
        """See `AbstractBasis.name`."""
        return "eq31-log-travel"

    def motion(self, velocity: Array, refresh_rate: Array) -> Array:
        """On the scale of `log_travel`. [1]."""
        return log_travel(velocity, refresh_rate)

    def fit(
        self, at: Conditions, quality: Float[Array, "tables n"], domain: Domain
    ) -> Float[Array, "tables c"]:
        """See `AbstractBasis.fit`."""
        del domain
        return _fit_eq31(*self._axes(at), quality)

    def formula(self) -> str:
        """See `AbstractBasis.formula`."""
        return _EQ31.replace("v", "u") + " with u = ln(1 + v/(0.05*f))"

    def describe(self) -> dict[str, Any]:
        """See `AbstractBasis.describe`."""
        return {"name": self.name}


class TensorPolynomial(AbstractBasis, strict=True):
    """A polynomial in the logarithms of travel, refresh rate and luminance.

    Chebyshev polynomials of the three, each scaled so that the domain is [-1, 1]: in
    plain units single precision would not hold the sum. Coefficients are in C order,
    the degree of luminance moving fastest.

    **Arguments:**

    - `degrees`: of `log_travel_beyond`, ln(refresh rate) and log luminance. >= 0.
    - `shortest_travel`: below which travel in one frame does not count: half a pixel.
      [deg], > 0.
    """

    degrees: tuple[int, int, int] = eqx.field(static=True)
    shortest_travel: float = eqx.field(static=True)

    def __check_init__(self):
        whole = all(isinstance(d, int) and d >= 0 for d in self.degrees)
        if len(self.degrees) != 3 or not whole:
            raise ValueError(
                f"`degrees` must be three whole numbers >= 0, got {self.degrees}."
            )
        if not (self.shortest_travel > 0 and np.isfinite(self.shortest_travel)):
            raise ValueError(
                f"`shortest_travel` must be > 0 deg and finite, got "
                f"{self.shortest_travel:g}."
            )

    @property
    def name(self) -> str:
        """See `AbstractBasis.name`."""
        return "tensor"

    @property
    def num_coefficients(self) -> int:
        return int(np.prod([d + 1 for d in self.degrees]))

    def evaluate(
        self, coefficients: Float[Array, "... c"], at: Conditions, domain: Domain
    ) -> Float[Array, "..."]:
        """See `AbstractBasis.evaluate`."""
        v, f, level = self._factors(at, domain)
        sizes = [d + 1 for d in self.degrees]
        c = coefficients.reshape(*coefficients.shape[:-1], *sizes)
        of_level = lambda i, j: _dot(level, lambda k: c[..., i, j, k])
        return _dot(v, lambda i: _dot(f, lambda j: of_level(i, j)))

    def fit(
        self, at: Conditions, quality: Float[Array, "tables n"], domain: Domain
    ) -> Float[Array, "tables c"]:
        """See `AbstractBasis.fit`."""
        basis = orthonormal(self._design(at, domain))
        exact = jax.lax.Precision.HIGHEST
        shares = jnp.matmul(quality, basis.values, precision=exact)
        return jnp.matmul(shares, basis.to_monomials.T, precision=exact)

    def fit_ordered(
        self,
        at: Conditions,
        quality: Float[Array, "tables rates n"],
        domain: Domain,
        dense: Conditions,
        order: RateOrder,
    ) -> Float[Array, "tables rates c"]:
        """See `AbstractBasis.fit_ordered`."""
        design, everywhere = self._design(at, domain), self._design(dense, domain)
        return fit_constrained_linear(
            design, quality, everywhere, order.pairs, order.margin
        )

    def constant(self, value: float) -> Float[Array, " c"]:
        """See `AbstractBasis.constant`."""
        return jnp.zeros(self.num_coefficients).at[0].set(value)

    def formula(self) -> str:
        """See `AbstractBasis.formula`."""
        return (
            "q = sum of c[i][j][k] * T_i(x) * T_j(y) * T_k(z), k fastest, with T the "
            "Chebyshev polynomials of the first kind and x, y, z = ln(max(v/f, "
            "shortest_travel_deg)), ln(f), L, each mapped linearly from the ends that "
            "it has in the domain to -1 and 1 (0 where the ends are the same)"
        )

    def describe(self) -> dict[str, Any]:
        """See `AbstractBasis.describe`."""
        return {
            "name": self.name,
            "degrees": list(self.degrees),
            "shortest_travel_deg": self.shortest_travel,
        }

    def _factors(self, at: Conditions, domain: Domain) -> list[Array]:
        travel = partial(log_travel_beyond, self.shortest_travel)
        ends = travel(domain.velocity, domain.refresh_rate[::-1])
        axes = (
            scaled(travel(at.velocity, at.refresh_rate), ends),
            scaled(jnp.log(at.refresh_rate), jnp.log(domain.refresh_rate)),
            scaled(at.log10_luminance, domain.log10_luminance),
        )
        return [_chebyshev(x, d) for x, d in zip(axes, self.degrees, strict=True)]

    def _design(self, at: Conditions, domain: Domain) -> Float[Array, "n c"]:
        v, f, level = self._factors(at, domain)
        every = v[:, :, None, None] * f[:, None, :, None] * level[:, None, None, :]
        return every.reshape(every.shape[0], -1)


_FROM_FILE: dict[str, Callable[..., AbstractBasis]] = {
    "eq31": lambda method: Eq31(method),
    "eq31-log-travel": lambda: Eq31LogTravel(),
    "tensor": lambda degrees, shortest_travel_deg: TensorPolynomial(
        tuple(degrees), shortest_travel_deg
    ),
}


def basis_from(described: dict[str, Any]) -> AbstractBasis:
    """The basis of a `describe`.

    **Raises:** `ValueError` for a name or a setting that no basis has.
    """
    settings = {k: v for k, v in described.items() if k != "name"}
    name = described.get("name")
    if name not in _FROM_FILE:
        known = ", ".join(_FROM_FILE)
        raise ValueError(f"`basis` must be one of {known}, got {name!r}.")
    try:
        return _FROM_FILE[name](**settings)
    except TypeError as error:
        raise ValueError(
            f"`basis` must have the settings of {name}, got {settings}."
        ) from error


_EQ31 = (
    "q = (W0 + W1*v + W2*f + W3*v^2 + W4*v*f + W5*f^2) * (W6*L^3 + W7*L^2 + W8*L + W9)"
)


@eqx.filter_jit
def _fit_eq31(
    velocity: Float[Array, " n"],
    refresh_rate: Float[Array, " n"],
    log10_luminance: Float[Array, " n"],
    quality: Float[Array, "tables n"],
) -> Float[Array, "tables 10"]:
    fit = jax.vmap(fit_eq31, in_axes=(None, None, None, 0))
    return fit(velocity, refresh_rate, log10_luminance, quality).coefficients


def _dot(
    values: Float[Array, "... n"], coefficient: Callable[[int], Array]
) -> Float[Array, "..."]:
    """Sum over the last axis, each value times a coefficient.

    Term by term XLA makes one loop of all sums, tens of times as fast as of arrays.
    """
    total = values[..., 0] * coefficient(0)
    for k in range(1, values.shape[-1]):
        total = total + values[..., k] * coefficient(k)
    return total


def _chebyshev(x: Array, degree: int) -> Array:
    """T_0 to T_degree of `x` in a new last axis."""
    values = [jnp.ones_like(x), x]
    for _ in range(degree - 1):
        values.append(2 * x * values[-1] - values[-2])
    return jnp.stack(values[: degree + 1], axis=-1)
