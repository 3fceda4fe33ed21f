"""One frame's choice of rates as a multiple-choice knapsack, checked."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from camojab._errors import check


class Problem(eqx.Module, strict=True):
    """Qualities and costs of every rate on every tile, and what may be spent.

    All in the floating dtype of the qualities. Costs that all tiles share are kept
    once, which makes everything that is computed of them quicker.
    """

    quality: Float[Array, "tiles rates"]
    cost: Float[Array, "#tiles rates"]
    budget: Float[Array, ""]

    @property
    def every_cost(self) -> Float[Array, "tiles rates"]:
        return jnp.broadcast_to(self.cost, self.quality.shape)

    @property
    def left(self) -> Float[Array, ""]:
        """Budget above the cheapest rate of every tile; negative if it does not fit."""
        return self.budget - jnp.sum(jnp.min(self.every_cost, axis=1))

    @property
    def cheapest(self) -> Int[Array, " tiles"]:
        """Rate that costs least; of several on a tile the best, and then the first."""
        least = self.cost == jnp.min(self.cost, axis=1, keepdims=True)
        return jnp.argmax(jnp.where(least, self.quality, -jnp.inf), axis=1)


def checked(
    quality: ArrayLike,
    cost: ArrayLike,
    budget: ArrayLike,
    *,
    throw: bool,
    is_cost: Callable[[Array], Bool[Array, "..."]] = lambda c: (c > 0) & (c < jnp.inf),
    rule: str = "> 0 and finite",
) -> Problem:
    """What every solver requires of its arguments.

    **Raises:** `ValueError` for a shape, a quality that is not finite, a cost against
    the `rule`, a budget that is NaN and, with `throw`, one below the cheapest map;
    under a JAX transformation the same words at run time.
    """
    quality = check("quality", quality, jnp.isfinite, "finite")
    if quality.ndim != 2 or quality.size == 0:
        raise ValueError(
            f"`quality` must have shape [tiles, rates], none of them 0, "
            f"got {quality.shape}."
        )
    if jnp.shape(cost) not in (quality.shape, quality.shape[1:]):
        raise ValueError(
            f"`cost` must have shape {quality.shape[1:]} or {quality.shape} to match "
            f"`quality`, got {jnp.shape(cost)}."
        )
    if jnp.shape(budget) != ():
        raise ValueError(f"`budget` must be one number, got shape {jnp.shape(budget)}.")
    cost = check("cost", cost, is_cost, rule).astype(quality.dtype)
    budget = check("budget", budget, lambda b: ~jnp.isnan(b), "a number, not NaN")
    cost = cost.reshape(-1, quality.shape[1])
    problem = Problem(quality, cost, budget.astype(quality.dtype))
    if not throw:
        return problem
    left = check(
        "budget - sum(min(cost, axis=1))",
        problem.left,
        lambda rest: rest >= 0,
        ">= 0 so that every tile can have its cheapest rate (pass `throw=False` to "
        "read `Selection.feasible` instead)",
    )
    # A check whose result is not used is dropped under a transformation.
    budget = jnp.where(left >= 0, problem.budget, jnp.nan)
    return Problem(problem.quality, problem.cost, budget)
