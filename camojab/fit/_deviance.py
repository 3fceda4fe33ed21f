"""Pairwise votes as residuals, so that least squares maximises their likelihood.

Half the sum of the squared deviance residuals is what the log likelihood of the model
falls short of that of the saturated one, which has a free preference for every pair.
"""

import jax.numpy as jnp
from jax.scipy.special import log_ndtr, xlogy
from jaxtyping import Array, Float


# Terms of the series of (t - log(1 + t))/t^2, exact to the last digit below |t| = 0.1.
_TERMS = 16


def log_preference(
    difference: Float[Array, "*pairs"], lapse: Float[Array, ""]
) -> Float[Array, "*pairs"]:
    """Log probability that A is chosen, of its lead in units of the noise (Case V).

    With probability `lapse`, in [0, 1), the observer guesses instead.
    """
    some = lapse > 0
    # A lapse that is all but zero rounds to it, where the logarithm has no slope.
    guess = jnp.where(some, jnp.log(0.5 * jnp.where(some, lapse, 1)), -jnp.inf)
    return jnp.logaddexp(guess, jnp.log1p(-lapse) + log_ndtr(difference))


def log_odds(
    difference: Float[Array, "*pairs"], lapse: Float[Array, ""]
) -> Float[Array, "*pairs"]:
    """Log odds that A is chosen rather than B."""
    return log_preference(difference, lapse) - log_preference(-difference, lapse)


def deviance_residual(
    difference: Float[Array, "*pairs"],
    lapse: Float[Array, ""],
    wins: Float[Array, "*pairs"],
    votes: Float[Array, "*pairs"],
) -> Float[Array, "*pairs"]:
    """Signed root of the deviance of each pair, 0 for a pair without votes.

    Smooth where the model meets the votes exactly, and finite for unanimous ones.

    **Source:** McCullagh and Nelder 1989, Generalized Linear Models, 2.4.3.
    """
    log_a, log_b = log_preference(difference, lapse), log_preference(-difference, lapse)
    share = wins / jnp.maximum(votes, 1)
    excess = jnp.exp(log_a) - share
    rarer = jnp.minimum(share, 1 - share)
    near = jnp.abs(excess) < 0.1 * rarer
    # The two forms of the divergence; each is kept away from where it has no slope.
    a, b = jnp.where(near, share, 0.5), jnp.where(near, 1 - share, 0.5)
    small = jnp.where(near, excess, 0)
    series = small * jnp.sqrt(2 * (_series(small / a) / a + _series(-small / b) / b))
    entropy = xlogy(share, share) + xlogy(1 - share, 1 - share)
    divergence = entropy - share * log_a - (1 - share) * log_b
    # What is not a number must stay so.
    some = ~near & ~(divergence <= 0)
    root = jnp.sqrt(2 * jnp.where(some, divergence, 1))
    direct = jnp.where(some, jnp.sign(excess) * root, 0)
    return jnp.sqrt(votes) * jnp.where(near, series, direct)


def saturated_log_likelihood(
    wins: Float[Array, " pairs"], votes: Float[Array, " pairs"]
) -> Float[Array, ""]:
    """Of the votes, with the share of each pair as its probability. [1], <= 0."""
    lost = votes - wins
    return jnp.sum(xlogy(wins, wins) + xlogy(lost, lost) - xlogy(votes, votes))


def _series(t: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """(t - log(1 + t))/t^2 for |t| < 0.1."""
    value = jnp.zeros_like(t)
    for k in range(_TERMS - 1, -1, -1):
        value = 1.0 / (k + 2) - t * value
    return value
