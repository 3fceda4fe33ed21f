"""Votes to just-noticeable differences: Thurstone's Case V by maximum likelihood."""

import enum
from collections.abc import Callable, Hashable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float

from .._newton import minimise, Place
from ._likelihood import log_likelihood, log_prior, Prior
from ._simulation import SIGMA


# Votes tell differences alone; where an error of 300 JND is as likely as not, nothing.
_LEAST_INFORMATION = 1e-5


class Gauge(enum.Enum):
    """Where 0 JND is, which no vote can tell.

    - `MEAN0`: at the mean of the conditions.
    - `FIX0`: at the first condition.

    **Source:** the option `regularization` of pwcmp.
    """

    MEAN0 = "mean0"
    FIX0 = "fix0"


class Scaling(eqx.Module):
    """JND of the conditions, and how the search for them ended.

    - `quality`: [JND], one per condition; 0 where the gauge says.
    - `log_likelihood`: of the votes, without the prior and binomial constants. [1].
    - `converged`: whether the search met its tolerance.
    """

    quality: Float[Array, " conditions"]
    log_likelihood: Float[Array, ""]
    converged: Bool[Array, ""]


class Solution(eqx.Module):
    """A scaling of the conditions that are `present`, with mean 0.

    `determined` is false, and the quality not a number, where a most likely difference
    is infinite or no vote tells.
    """

    quality: Float[Array, " n"]
    log_likelihood: Float[Array, ""]
    converged: Bool[Array, ""]
    determined: Bool[Array, ""]


def scale(
    wins: ArrayLike, *, prior: Prior = Prior.NONE, gauge: Gauge = Gauge.MEAN0
) -> Scaling:
    """Scale one set of conditions that were compared with each other.

    **Arguments:**

    - `wins`: `wins[i, j]` is how often `i` was preferred to `j`. Non-negative, square,
        with a diagonal of zeros, for two conditions or more.
    - `prior`: see `Prior`. Votes that are unanimous have no finite answer without one.
    - `gauge`: see `Gauge`.

    **Raises:** `ValueError` for counts that are not such a table, for conditions whose
    comparisons do not connect them all (the message lists the groups; a condition that
    was never compared is one of its own), and where the most likely difference is
    infinite.

    **Accuracy:** the numbers of pwcmp (priors `NONE` and `GAUSSIAN`) to 1e-5 JND and
    the published JND of Jindal et al. 2021 (`BOUNDED`) to 2e-5 JND, in float64 and in
    float32, which differ by less than 1e-6 JND on these votes.

    **Source:** Thurstone 1927, Case V, with 75 % preferring at 1 JND.

    **Example:**

    >>> import numpy as np
    >>> from camojab.votes import scale
    >>> wins = np.array([[0, 15, 18], [5, 0, 14], [2, 6, 0]])
    >>> print(np.asarray(scale(wins).quality).round(2))  # [JND]
    [ 0.96 -0.07 -0.89]
    """
    counts = counts_of(wins)
    check_linked(counts, range(len(counts)), prior, "`wins`")
    found = solve(jnp.asarray(counts, float), jnp.ones(len(counts), bool), prior=prior)
    check_determined(bool(found.determined), "`wins`")
    zero = found.quality[0] if gauge is Gauge.FIX0 else 0.0
    return Scaling(found.quality - zero, found.log_likelihood, found.converged)


@eqx.filter_jit
def solve(
    wins: Float[Array, "n n"], present: Bool[Array, " n"], *, prior: Prior
) -> Solution:
    """Scale whatever the votes are; conditions that are not present get 0 JND."""

    def loss(quality: Float[Array, " n"]) -> Float[Array, ""]:
        belief = log_prior(quality, wins, present, prior)
        return -log_likelihood(quality, wins) - belief

    # Neither the mean nor what is not present matters to the votes.
    here = present.astype(wins.dtype)
    held = jnp.outer(here, here) + jnp.diag(1.0 - here)
    votes = jnp.sum(wins, axis=0) + jnp.sum(wins, axis=1)
    share = (jnp.sum(wins, axis=1) + 0.5) / (votes + 1.0)
    start = _centred(SIGMA * jax.scipy.stats.norm.ppf(share), here)
    found = minimise(_look(loss, held), start)
    definite = _definite(found.place)
    quality = jnp.where(definite, _centred(found.place.at, here), jnp.nan)
    return Solution(quality, log_likelihood(quality, wins), found.converged, definite)


def _look(
    function: Callable[[Float[Array, " n"]], Float[Array, ""]],
    held: Float[Array, "n n"],
) -> Callable[[Float[Array, " n"]], Place]:
    """The function with its Hessian.

    `held` is added to the latter, so that it is definite in the directions in which the
    function is constant, along which a search does not move.
    """

    def slope(x: Float[Array, " n"]) -> tuple[Array, tuple[Array, Array]]:
        value, gradient = jax.value_and_grad(function)(x)
        return gradient, (value, gradient)

    def look(x: Float[Array, " n"]) -> Place:
        hessian, (value, gradient) = jax.jacfwd(slope, has_aux=True)(x)
        return Place(x, value, gradient, hessian + held)

    return look


def _definite(place: Place) -> Bool[Array, ""]:
    """Whether votes tell something in every direction; if not, an end is infinite."""
    epsilon = float(jnp.finfo(place.at.dtype).eps)
    noise = 16.0 * epsilon * jnp.max(jnp.diagonal(place.curvature))
    least = jnp.maximum(_LEAST_INFORMATION, noise)
    enough = place.curvature - least * jnp.eye(place.at.size, dtype=place.at.dtype)
    factor = jnp.linalg.cholesky(enough)
    # Infinite still where the function is not a number at the start.
    return jnp.isfinite(place.value) & jnp.all(jnp.isfinite(factor))


def _centred(
    quality: Float[Array, " n"], here: Float[Array, " n"]
) -> Float[Array, " n"]:
    return (quality - jnp.sum(quality * here) / jnp.sum(here)) * here


def counts_of(wins: ArrayLike) -> Float[np.ndarray, "n n"]:
    """The counts as numbers, or an error where they are not such a table."""
    counts = np.asarray(wins, float)
    if counts.ndim != 2 or counts.shape[0] != counts.shape[1]:
        raise ValueError(f"`wins` must be square, got {list(counts.shape)}.")
    if len(counts) < 2:
        raise ValueError(
            f"`wins` must be of two conditions or more, got {len(counts)}."
        )
    if not (np.isfinite(counts) & (counts >= 0)).all():
        raise ValueError("`wins` must hold non-negative counts only.")
    if np.diagonal(counts).any():
        own = int(np.flatnonzero(np.diagonal(counts))[0])
        raise ValueError(
            "`wins` must have zeros on its diagonal, got votes of condition "
            f"{own} against itself."
        )
    return counts


def check_linked(
    counts: Float[np.ndarray, "n n"],
    names: Sequence[Hashable],
    prior: Prior,
    what: str,
) -> None:
    """Fail, naming the conditions, where no finite scaling exists for want of votes."""
    pieces = _components(counts, names)
    if len(pieces) > 1:
        raise ValueError(
            f"{what} must connect all conditions by comparisons, got separate groups "
            f"{pieces}."
        )
    pieces = _components(counts, names, strong=True)
    if prior is Prior.NONE and len(pieces) > 1:
        raise ValueError(
            f"{what} has conditions that never lost, or never won, against the rest, "
            f"so that their JND is infinite without a prior: groups {pieces}."
        )


def check_determined(determined: bool, what: str) -> None:
    if not determined:
        raise ValueError(
            f"{what} must have some votes against the majority for its most likely "
            "differences to be finite under this prior, got too few: use "
            "`Prior.BOUNDED`, or more votes."
        )


def _components(
    links: np.ndarray, names: Sequence[Hashable], *, strong: bool = False
) -> list[list[Hashable]]:
    from scipy.sparse.csgraph import connected_components

    kind = "strong" if strong else "weak"
    count, label = connected_components(links > 0, directed=True, connection=kind)
    return [
        [names[k] for k in np.flatnonzero(label == i).tolist()] for i in range(count)
    ]
