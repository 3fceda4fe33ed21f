"""What a prediction is held against, as residuals and as a likelihood."""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.nn import sigmoid
from jaxtyping import Array, Bool, Float, Int

from ..votes._simulation import SIGMA
from ._deviance import deviance_residual, log_odds, saturated_log_likelihood


class JndTarget(eqx.Module):
    """Measured quality, with normal errors of one unknown standard deviation.

    - `measured`: [JND].
    - `weight`: 0 for a row that is left out or that quality is relative to; else 1.
    """

    measured: Float[Array, " rows"]
    weight: Float[Array, " rows"]

    def residuals(
        self, quality: Float[Array, " rows"], lapse: Float[Array, ""]
    ) -> Float[Array, " rows"]:
        """Predicted minus measured quality. [JND]."""
        del lapse
        return self.weight * (quality - self.measured)

    def judged(
        self, quality: Float[Array, " rows"], lapse: Float[Array, ""]
    ) -> Float[Array, " rows"]:
        """What the data are independent measurements of."""
        del lapse
        return quality

    def score(self, judged: Float[Array, " rows"]) -> Float[Array, " rows"]:
        """Derivative of half the squared residuals along each of `judged`, negated."""
        return self.weight * (self.measured - judged)

    def information(self, judged: Float[Array, " rows"]) -> Float[Array, " rows"]:
        """Expected second derivative of the same."""
        del judged
        return self.weight

    def variance(
        self, residuals: Float[Array, " rows"], constants: int
    ) -> Float[Array, ""]:
        """Of one measurement, from what so many fitted constants leave. [JND^2]."""
        freedom = jnp.maximum(jnp.sum(self.weight) - constants, 1)
        return jnp.sum(residuals**2) / freedom

    def log_likelihood(self, residuals: Float[Array, " rows"]) -> Float[Array, ""]:
        """With the most likely standard deviation."""
        count = jnp.sum(self.weight)
        variance = jnp.sum(residuals**2) / count
        return -0.5 * count * (jnp.log(2 * math.pi * variance) + 1)

    def size(self) -> int:
        """Number of measurements."""
        return int(np.sum(np.asarray(self.weight)))

    # The standard deviation is estimated too.
    NUISANCES = 1


class VoteTarget(eqx.Module):
    """Votes on pairs of rows: Thurstone Case V observers, some of whom guess.

    - `a`, `b`: rows of the two conditions.
    - `wins`: votes for a, of `votes`; 0 of 0 for a pair that is left out.
    """

    a: Int[Array, " pairs"]
    b: Int[Array, " pairs"]
    wins: Float[Array, " pairs"]
    votes: Float[Array, " pairs"]

    def residuals(
        self, quality: Float[Array, " rows"], lapse: Float[Array, ""]
    ) -> Float[Array, " pairs"]:
        """Signed roots of the deviance. [1]."""
        lead = self._lead(quality)
        return deviance_residual(lead, lapse, self.wins, self.votes)

    def judged(
        self, quality: Float[Array, " rows"], lapse: Float[Array, ""]
    ) -> Float[Array, " pairs"]:
        """Log odds of a vote for a."""
        return log_odds(self._lead(quality), lapse)

    def score(self, judged: Float[Array, " pairs"]) -> Float[Array, " pairs"]:
        """Derivative of the log likelihood along each of `judged`."""
        lost = self.votes - self.wins
        return self.wins * sigmoid(-judged) - lost * sigmoid(judged)

    def information(self, judged: Float[Array, " pairs"]) -> Float[Array, " pairs"]:
        """Expected of each pair, about its log odds."""
        return self.votes * sigmoid(judged) * sigmoid(-judged)

    def variance(
        self, residuals: Float[Array, " pairs"], constants: int
    ) -> Float[Array, ""]:
        """1: a vote has no spread but its own."""
        del constants
        return jnp.ones((), residuals.dtype)

    def log_likelihood(self, residuals: Float[Array, " pairs"]) -> Float[Array, ""]:
        """Of the votes in the order in which they were cast."""
        saturated = saturated_log_likelihood(self.wins, self.votes)
        return saturated - 0.5 * jnp.sum(residuals**2)

    def size(self) -> int:
        """Number of votes."""
        return round(float(np.sum(np.asarray(self.votes))))

    def _lead(self, quality: Float[Array, " rows"]) -> Float[Array, " pairs"]:
        return (quality[self.a] - quality[self.b]) / SIGMA

    NUISANCES = 0


Target = JndTarget | VoteTarget


def jnd_target(table: Any) -> JndTarget:
    """The target of `Observations.table`."""
    relative = table["reference"].to_numpy(int) != np.arange(len(table))
    measured = jnp.asarray(table["quality_jnd"].to_numpy(), float)
    return JndTarget(measured, jnp.asarray(relative, float))


def vote_pairs(votes: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The different pairs of rows a < b, the pair of each vote, and who won it."""
    a, b = (votes[side].to_numpy(int) for side in ("a", "b"))
    swapped = a > b
    ordered = np.stack([np.where(swapped, b, a), np.where(swapped, a, b)], axis=1)
    pairs, code = np.unique(ordered, axis=0, return_inverse=True)
    won = votes["a_preferred"].to_numpy(bool) != swapped
    return pairs, code.reshape(-1), won


def vote_target(votes: Any, counted: Bool[np.ndarray, " votes"]) -> VoteTarget:
    """The target of those of `Comparisons.votes` that count; it has every pair."""
    pairs, code, won = vote_pairs(votes)
    counts = [
        np.bincount(code[w], minlength=len(pairs)) for w in (counted & won, counted)
    ]
    a, b = (jnp.asarray(side, jnp.int32) for side in pairs.T)
    return VoteTarget(a, b, *(jnp.asarray(count, float) for count in counts))
