"""Samples of the posterior by NUTS, to hold the standard errors against."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from ._fit import Fit


@dataclass(frozen=True, eq=False)
class Posterior:
    """Draws of the constants, given the data.

    - `free`: names of the constants, in the order of `values`; units as in `Fit`.
    - `values`: draws of each chain.
    - `r_hat`: potential scale reduction of each constant, 1 where the chains agree.
    - `divergent`: share of draws at which the integration failed; 0 in a sound run.
    """

    free: tuple[str, ...]
    values: Float[np.ndarray, "chains draws free"]
    r_hat: Float[np.ndarray, " free"]
    divergent: float


def posterior(
    fit: Fit,
    *,
    key: Key[Array, ""],
    draws: int = 1000,
    warmup: int = 500,
    chains: int = 2,
) -> Posterior:
    """Draw from the posterior by the No-U-Turn sampler.

    The prior is flat in the logarithms that `fit` searches (and in the log odds of the
    lapse); the standard deviation of JND is integrated out under Jeffreys' prior. Needs
    the extra `posterior` (blackjax), and a fit whose steps take milliseconds (see
    `fit`). Without much doubt in the data the draws agree with `Fit.covariance`.

    **Arguments:** `draws` kept and `warmup` dropped of each of `chains`, all >= 2.

    **Raises:** `ValueError` for numbers out of range; `ImportError` without blackjax.

    **Source:** Hoffman and Gelman 2014, JMLR 15; `r_hat` as in Gelman et al. 2013,
    Bayesian Data Analysis, 11.4.
    """
    for name, value in (("draws", draws), ("warmup", warmup), ("chains", chains)):
        if value < 2:
            raise ValueError(f"`{name}` must be >= 2, got {value}.")
    # The sampler multiplies arrays of different ranks.
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        points, divergent = _sample(fit, key, draws, warmup, chains)
    constants = fit.problem.constants
    natural = jax.vmap(jax.vmap(lambda point: constants.at(point).values()))
    return Posterior(
        fit.free,
        np.asarray(natural(points), np.float64),
        _r_hat(np.asarray(points, np.float64)),
        float(np.mean(np.asarray(divergent))),
    )


def _sample(
    fit: Fit, key: Key[Array, ""], draws: int, warmup: int, chains: int
) -> tuple[Float[Array, "chains draws free"], Array]:
    import blackjax

    problem = fit.problem
    adapt: Any = blackjax.window_adaptation(blackjax.nuts, problem.log_likelihood)
    slope = np.asarray(problem.constants.at(jnp.asarray(fit.point)).slope())
    spread = np.sqrt(np.diag(fit.covariance)) / slope

    def chain(key: Key[Array, ""], begin: Float[Array, " free"]):
        warm, run = jax.random.split(key)
        (state, tuned), _ = adapt.run(warm, begin, num_steps=warmup)
        step: Any = blackjax.nuts(problem.log_likelihood, **tuned).step

        def advance(state, key):
            state, info = step(key, state)
            return state, (state.position, info.is_divergent)

        return jax.lax.scan(advance, state, jax.random.split(run, draws))[1]

    at, *keys = jax.random.split(key, chains + 1)
    start = jnp.asarray(fit.point)
    # Chains that start apart show by their agreement that they have forgotten it.
    apart = jax.random.normal(at, (chains, start.size), start.dtype)
    begins = start + apart * jnp.asarray(spread, start.dtype)
    run = eqx.filter_jit(chain)
    found = [run(own, begin) for own, begin in zip(keys, begins, strict=True)]
    points, divergent = (jnp.stack(part) for part in zip(*found, strict=True))
    return points, divergent


def _r_hat(points: Float[np.ndarray, "chains draws free"]) -> np.ndarray:
    """Of the halves of the chains, so that a drift within one shows too."""
    half = points.shape[1] // 2
    parts = np.concatenate([points[:, :half], points[:, half : 2 * half]])
    within = parts.var(axis=1, ddof=1).mean(axis=0)
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    return np.sqrt((half - 1) / half + between / within)
