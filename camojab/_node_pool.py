"""Pooled energies carried over to a few frequencies: what `Pooled` evaluates.

Everything sharp (texture, mip level, rate, replicas) is in the pooled energies, and all
that a display and a velocity multiply them with is smooth. So the energies are summed
into the nodes of that smooth function once, and every further condition takes it at the
nodes alone, whatever the formulation.
"""

import math
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._condition import Condition, log_eye_blur, sensitivity_power
from ._spectrum import SIZE


class NodePool(eqx.Module):
    """Energies of a texture on nodes, for each of some settings. [1].

    - `lost`: what the reference has more than the shaded spectrum.
    - `kept`: the shaded spectrum's.
    - `moved`: the shaded spectrum's about its temporal replica, for each place of the
      replica; first what lies at spatial frequency 0.
    - `radial`, `along`: the nodes: frequency, and its part along the motion. [bins].
    - `places`: of the temporal replica, rising. [bins].
    """

    lost: Float[Array, "*settings nodes"]
    kept: Float[Array, "*settings nodes nodes"]
    moved: Float[Array, "*settings places nodes+1"]
    radial: Float[Array, "*settings nodes"]
    along: Float[Array, "*settings nodes"]
    places: Float[Array, "*settings places"]


def replica_places(single: int, farthest: int) -> Float[np.ndarray, " places"]:
    """Every bin up to `single`, a power of two, then `single / 2` to the octave."""
    octaves = math.ceil(math.log2(farthest / single))
    steps = single + 2 * np.arange(single // 2)
    further = [2**i * steps for i in range(octaves)]
    places = np.concatenate([np.arange(single), *further])
    return np.append(places[places < farthest], farthest).astype(float)


def cells(nodes: int, places: int) -> int:
    """Number of energies in the pool of so many nodes and places."""
    return nodes**2 + nodes + places * (nodes + 1)


def spatial(
    p: NodePool, setting: Int[Array, ""], c: Condition, area: Float[Array, ""]
) -> Float[Array, ""]:
    """E_s: sums over the nodes of a setting times `area`."""
    i = _index(p, setting)
    step = c.display.ppd / SIZE
    blurred = -jnp.expm1(c.parameters.beta * log_eye_blur(p.along[i] * step, c))
    still = sensitivity_power(p.radial[i] * step, jnp.zeros_like(step), 0.0, c)
    return area * jnp.dot(still, p.lost[i] + jnp.dot(p.kept[i], blurred))


def temporal(
    p: NodePool,
    setting: Int[Array, ""],
    c: Condition,
    place: Float[Array, ""],
    area: Float[Array, ""],
) -> Float[Array, ""]:
    """E_t: sums over the nodes about the replica's `place` [bins] times `area`."""
    i = _index(p, setting)
    rho = p.radial[i] * (c.display.ppd / SIZE)
    flicker = sensitivity_power(rho, c.display.refresh_rate, 0.0, c)
    settings, places, columns = p.moved.shape
    # One gather of four rows: a setting's whole table would not fit for every row.
    rows, first = p.moved.reshape(settings * places, columns), i * places
    moved = _between(p.places[0], lambda j: rows[first + j], place)
    return area * (moved[0] + jnp.dot(flicker, moved[1:]))


def _index(p: NodePool, setting: Int[Array, ""]) -> Int[Array, ""] | int:
    """Of a single setting nothing has to be gathered."""
    return 0 if p.lost.shape[0] == 1 else setting


def _between(
    x: Float[Array, " n"],
    row: Callable[[Int[Array, ""]], Float[Array, " k"]],
    at: Float[Array, ""],
) -> Float[Array, " k"]:
    """Cubic Hermite interpolation of rows, with central differences for slopes."""
    last = x.shape[0] - 1
    at = jnp.minimum(at, x[-1])
    i = jnp.clip(jnp.sum(x <= at) - 1, 0, last - 1)
    before, after = jnp.maximum(i - 1, 0), jnp.minimum(i + 2, last)
    width = x[i + 1] - x[i]
    t = (at - x[i]) / width
    # Shares of the slopes at both ends, each a difference of the rows around it.
    near = t * (1.0 - t) ** 2 * width / (x[i + 1] - x[before])
    far = t**2 * (t - 1.0) * width / (x[after] - x[i])
    here = 1.0 - t**2 * (3.0 - 2.0 * t)
    return (
        (here - far) * row(i)
        + (1.0 - here + near) * row(i + 1)
        - near * row(before)
        + far * row(after)
    )
