"""Votes to just-noticeable differences: Thurstone's Case V by maximum likelihood."""

import enum

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, ArrayLike, Bool, Float

from ._simulation import SIGMA


class Prior(enum.Enum):
    """What is believed of a pair's difference before it is voted on.

    - `NONE`: nothing; conditions that one side wins unanimously drift apart.
    - `BOUNDED`: a unanimous pair is likelier a small difference than a large one,
      relative to the range of all. The published JND of Jindal et al. 2021 used it.
    - `GAUSSIAN`: the difference is one that some pair's votes would suggest.

    **Source:** pwcmp (Perez-Ortiz and Mantiuk 2017, arXiv:1712.03686); `BOUNDED` as in
    its releases of 2018 to 2023.
    """

    NONE = "none"
    BOUNDED = "bounded"
    GAUSSIAN = "gaussian"


class Scaling(eqx.Module):
    """JND of the conditions, mean 0, and how the search for them ended.

    - `quality`: [JND], one per condition.
    - `log_likelihood`: of the votes, without the prior and binomial constants. [1].
    - `converged`: whether the search met its tolerance.
    """

    quality: Float[Array, " conditions"]
    log_likelihood: Float[Array, ""]
    converged: Bool[Array, ""]


def scale(wins: ArrayLike, *, prior: Prior = Prior.NONE) -> Scaling:
    """Scale one set of conditions that were compared with each other.

    **Arguments:**

    - `wins`: `wins[i, j]` is how often `i` was preferred to `j`. Non-negative, square.
    - `prior`: see `Prior`.

    **Raises:** `ValueError` for counts that are not a square table of non-negative
    numbers, for conditions whose comparisons do not connect them all, and, without a
    prior, where the most likely difference is infinite.

    **Source:** Thurstone 1927, Case V, with 75 % preferring at 1 JND.
    """
    counts = np.asarray(wins, float)
    _check_counts(counts)
    if prior is Prior.NONE:
        _check_bounded(counts)
    return _scale(jnp.asarray(counts, float), prior)


@eqx.filter_jit
def _scale(wins: Float[Array, "n n"], prior: Prior) -> Scaling:
    votes = wins + wins.T
    share = (jnp.sum(wins, axis=1) + 0.5) / (jnp.sum(votes, axis=1) + 1.0)
    start = SIGMA * jax.scipy.stats.norm.ppf(share)
    tolerance = float(jnp.finfo(wins.dtype).eps) ** 0.6

    def loss(free: Array, counts: Array) -> Array:
        quality = jnp.concatenate([jnp.zeros_like(free[:1]), free])
        return -_log_likelihood(quality, counts) - _log_prior(quality, counts, prior)

    found = optx.minimise(
        loss,
        optx.BFGS(rtol=tolerance, atol=tolerance),
        (start - start[0])[1:],
        wins,
        max_steps=2000,
        throw=False,
    )
    quality = jnp.concatenate([jnp.zeros_like(start[:1]), found.value])
    return Scaling(
        quality - jnp.mean(quality),
        _log_likelihood(quality, wins),
        found.result == optx.RESULTS.successful,
    )


def _log_preference(quality: Float[Array, " n"]) -> Float[Array, "n n"]:
    difference = quality[:, None] - quality[None, :]
    return jax.scipy.stats.norm.logcdf(difference / SIGMA)


def _log_likelihood(
    quality: Float[Array, " n"], wins: Float[Array, "n n"]
) -> Float[Array, ""]:
    return jnp.sum(wins * _log_preference(quality))


def _log_prior(
    quality: Float[Array, " n"], wins: Float[Array, "n n"], prior: Prior
) -> Float[Array, ""]:
    if prior is Prior.NONE:
        return jnp.zeros((), quality.dtype)
    each = {Prior.BOUNDED: _bounded, Prior.GAUSSIAN: _gaussian}[prior](quality, wins)
    compared = wins + wins.T > 0
    # Half: the source counts a pair in either order, the likelihood here counts once.
    return 0.5 * jnp.sum(jnp.where(compared, jnp.log(each + 0.1), 0.0))


def _bounded(
    quality: Float[Array, " n"], wins: Float[Array, "n n"]
) -> Float[Array, "n n"]:
    spread = jnp.max(quality) - jnp.min(quality) + 1.0
    unanimous = (wins == 0) | (wins.T == 0)
    # The density of a difference within `spread` would subtract the difference; the
    # program that scaled the published JND subtracts the votes.
    density = jnp.maximum(1.0 / spread - wins / spread**2, 0.0)
    return jnp.where(unanimous, density, 1.0)


def _gaussian(
    quality: Float[Array, " n"], wins: Float[Array, "n n"]
) -> Float[Array, "n n"]:
    votes = wins + wins.T
    softened = jnp.where(wins == 0, 1.0, jnp.where(wins.T == 0, wins - 1.0, wins))
    log_p = _log_preference(quality).reshape(-1, 1)
    log_q = _log_preference(quality).T.reshape(-1, 1)
    won = softened.reshape(1, -1)
    lost = (votes - softened).reshape(1, -1)
    compared = (votes > 0).reshape(-1)
    log_a = jnp.where(compared[:, None], won * log_p + lost * log_q, -jnp.inf)
    belief = jax.nn.softmax(log_a, axis=0)
    return jnp.sum(jnp.where(compared[None, :], belief, 0.0), axis=1).reshape(
        votes.shape
    )


def _check_counts(counts: Float[np.ndarray, "..."]) -> None:
    if counts.ndim != 2 or counts.shape[0] != counts.shape[1]:
        raise ValueError(f"`wins` must be square, got {list(counts.shape)}.")
    if len(counts) < 2:
        raise ValueError(f"`wins` must have two conditions or more, got {len(counts)}.")
    if not (np.isfinite(counts) & (counts >= 0)).all():
        raise ValueError("`wins` must hold non-negative counts only.")
    pieces = _components(counts + counts.T)
    if len(pieces) > 1:
        raise ValueError(
            "`wins` must connect all conditions by comparisons, got separate groups "
            f"{pieces}."
        )


def _check_bounded(counts: Float[np.ndarray, "n n"]) -> None:
    pieces = _components(counts, strong=True)
    if len(pieces) > 1:
        raise ValueError(
            "`wins` has conditions that never lost, or never won, against the rest, "
            f"so that their JND is infinite without a prior: groups {pieces}."
        )


def _components(links: np.ndarray, *, strong: bool = False) -> list[list[int]]:
    from scipy.sparse.csgraph import connected_components

    kind = "strong" if strong else "weak"
    count, label = connected_components(links > 0, directed=True, connection=kind)
    return [np.flatnonzero(label == i).tolist() for i in range(count)]
