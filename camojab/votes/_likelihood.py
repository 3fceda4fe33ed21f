"""What a scaling maximises: the likelihood of votes, and beliefs about differences."""

import enum

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ._simulation import SIGMA


class Prior(enum.Enum):
    """What is believed of a pair's difference before it is voted on.

    - `NONE`: nothing; conditions that one side wins unanimously drift apart.
    - `BOUNDED`: a unanimous pair is likelier a small difference than a large one,
      relative to the range of all. The published JND of Jindal et al. 2021 used it.
      Where nearly all pairs are unanimous, as they are for one observer who saw each
      once, the search may end at an edge of this prior (`converged` is false) or find
      differences that no vote tells (an error).
    - `GAUSSIAN`: the difference is one that some pair's votes would suggest. Its answer
      may be infinite where all pairs are unanimous.

    **Source:** pwcmp (Perez-Ortiz and Mantiuk 2017, arXiv:1712.03686); `BOUNDED` as in
    its releases of 2018 to 2023.
    """

    NONE = "none"
    BOUNDED = "bounded"
    GAUSSIAN = "gaussian"


# Width [JND] over which the largest of several qualities passes from one to the next:
# the range of the prior has an edge there, on which a search would stall.
_EDGE = 1e-3


def log_likelihood(
    quality: Float[Array, " n"], wins: Float[Array, "n n"]
) -> Float[Array, ""]:
    """Of the votes, without the binomial coefficients."""
    return jnp.sum(wins * _log_preference(quality))


def log_prior(
    quality: Float[Array, " n"],
    wins: Float[Array, "n n"],
    present: Bool[Array, " n"],
    prior: Prior,
) -> Float[Array, ""]:
    if prior is Prior.NONE:
        return jnp.zeros((), quality.dtype)
    if prior is Prior.BOUNDED:
        belief = _bounded(quality, wins, present)
    else:
        belief = _gaussian(quality, wins)
    # Half: the source counts a pair in either order, the likelihood here counts once.
    return 0.5 * jnp.sum(jnp.where(wins + wins.T > 0, jnp.log(belief + 0.1), 0.0))


def _log_preference(quality: Float[Array, " n"]) -> Float[Array, "n n"]:
    difference = quality[:, None] - quality[None, :]
    return jax.scipy.stats.norm.logcdf(difference / SIGMA)


def _bounded(
    quality: Float[Array, " n"], wins: Float[Array, "n n"], present: Bool[Array, " n"]
) -> Float[Array, "n n"]:
    spread = _largest(quality, present) + _largest(-quality, present) + 1.0
    # The density of a difference within `spread` would subtract the difference; the
    # program that scaled the published JND subtracts the votes.
    density = jnp.maximum(1.0 / spread - wins / spread**2, 0.0)
    return jnp.where((wins == 0) | (wins.T == 0), density, 1.0)


def _largest(x: Float[Array, " n"], present: Bool[Array, " n"]) -> Float[Array, ""]:
    return _EDGE * jax.nn.logsumexp(jnp.where(present, x / _EDGE, -jnp.inf))


def _gaussian(
    quality: Float[Array, " n"], wins: Float[Array, "n n"]
) -> Float[Array, "n n"]:
    """How much the votes of each pair, softened, suggest each difference."""
    votes = wins + wins.T
    softened = jnp.where(wins == 0, 1.0, jnp.where(wins.T == 0, wins - 1.0, wins))
    log_p = _log_preference(quality)
    either = jnp.stack([log_p.ravel(), log_p.T.ravel()], axis=1)
    # Each pair of votes once: in the other order they suggest the opposite.
    once = np.triu_indices(len(quality), 1)
    log_a = either @ jnp.stack([softened[once], (votes - softened)[once]])
    belief = jax.nn.softmax(log_a, axis=0, where=(votes > 0).reshape(-1, 1))
    suggested = (belief @ (votes[once] > 0).astype(belief.dtype)).reshape(votes.shape)
    return suggested + suggested.T
