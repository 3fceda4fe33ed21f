"""The model on a few frequencies: pooled once a setting, then a microsecond each."""

import functools
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._batch import Batch, batch, sampled
from ._chains import CHAIN
from ._condition import Condition, Terms
from ._fidelity import AbstractFidelity, Distortion, SAFETY
from ._node_pool import cells, NodePool, replica_places, spatial, temporal
from ._paper import PaperPool
from ._parameters import Formulation
from ._released import ReleasedPool
from ._spectrum import Spectrum


# Conditions that are evaluated side by side.
_CHUNK = 4096


@dataclass(frozen=True)
class Pooled(AbstractFidelity):
    """Energies pooled into a few thousand cells, all that is smooth applied to each.

    Pays where a texture, mip level and rate, a setting, meets more than some dozens of
    displays and velocities: pooling costs as much as about ten conditions of `Exact`,
    a condition afterwards a hundredth of one or less (`camojab bench` measures both).
    Settings are told apart by value where they are not traced, otherwise by the shape
    of the fields of `Shading`, `beta`, `mipmap_width` and `vrs`. Derivatives are those
    of the approximation, with respect to everything.

    **Arguments:** `cells`: energies that stand for a texture, at most. From 400 to
    50 000; more are slower and more accurate.

    **Raises:** `ValueError` for `cells` out of range.

    **Accuracy:** `error_jnd` estimates it for given conditions.
    """

    cells: int = 5000

    def __post_init__(self):
        if not 400 <= self.cells <= 50_000:
            raise ValueError(f"`cells` must be from 400 to 50000, got {self.cells!r}.")

    def distortion(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Distortion:
        """See `AbstractFidelity.distortion`."""
        of = batch(condition, spectrum.amplitude.dtype)
        parts = _evaluated(spectrum, of, formulation, *_size(self.cells, formulation))
        return Distortion(
            *jax.tree.map(lambda x: x.reshape(of.shape), parts), fidelity=str(self)
        )

    def error_jnd(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> float:
        """Half as much again as the largest difference to a finer pool. [JND].

        Taken over all conditions, or some two thousand of them with the extremes of
        every field.

        **Raises:** `ValueError` under a JAX transformation.
        """
        of = sampled(batch(condition, spectrum.amplitude.dtype))
        nodes, single = _size(self.cells, formulation)
        coarse = _evaluated(spectrum, of, formulation, nodes, single)
        # One size for most rungs, so that it is compiled once.
        finer = max(nodes + 8, 64), max(2 * single, 128)
        fine = _evaluated(spectrum, of, formulation, *finer)
        p = of.conditions.parameters
        error = jnp.abs(p.ws * (coarse[0] - fine[0]))
        error += jnp.abs(p.wt * (coarse[1] - fine[1]))
        return SAFETY * float(jnp.max(error, initial=0.0))


@functools.cache
def _size(most: int, formulation: Formulation) -> tuple[int, int]:
    """Nodes and single places of the most accurate pool of so many cells."""
    # Multiples of 8 fill a vector's lanes; others take up to four times as long.
    sizes = [(n, s) for n in range(8, 136, 8) for s in (8, 16, 32, 64, 128, 256)]
    count = lambda n, s: cells(n, len(_places(s, formulation)))
    # What both leave of 50 JND, measured: each node and each place tells.
    first = {Formulation.RELEASED: 1.0, Formulation.PAPER: 10.0}[formulation]
    error = lambda size: first * 10.0 ** (-size[0] / 8) + 0.15 / size[1]
    return min((size for size in sizes if count(*size) <= most), key=error)


def _places(single: int, formulation: Formulation) -> Float[np.ndarray, " places"]:
    return replica_places(single, CHAIN[formulation].FARTHEST)


def pool_on_nodes(
    energies: ReleasedPool | PaperPool, formulation: Formulation, fidelity: Pooled
) -> NodePool:
    """The pool of one setting carried over to nodes."""
    nodes, single = _size(fidelity.cells, formulation)
    places = _places(single, formulation)
    one = CHAIN[formulation].on_nodes(energies, nodes, places)
    return jax.tree.map(lambda x: x[None], one)


def _evaluated(
    spectrum: Spectrum, of: Batch, formulation: Formulation, nodes: int, single: int
) -> tuple[Float[Array, " rows"], Float[Array, " rows"], Terms]:
    if len(of.setting) == 0:
        nothing, none = jnp.zeros(0, spectrum.amplitude.dtype), jnp.zeros(0, bool)
        return nothing, nothing, Terms(none, none, none, jnp.zeros(0, int))
    row = lambda x: x[of.first] if x.ndim else jnp.broadcast_to(x, of.first.shape)
    settings = jax.tree.map(row, of.conditions)
    pools = _pools(spectrum, settings, formulation, nodes, single)
    return on_pools(pools, of.conditions, jnp.asarray(of.setting), formulation)


@eqx.filter_jit
def _pools(
    spectrum: Spectrum,
    settings: Condition,
    formulation: Formulation,
    nodes: int,
    single: int,
) -> NodePool:
    chain, places = CHAIN[formulation], _places(single, formulation)

    @jax.checkpoint
    def of_setting(c: Condition) -> NodePool:
        parts = c.shading, c.components, c.parameters
        return chain.on_nodes(chain.pool(spectrum.amplitude, *parts), nodes, places)

    return jax.lax.map(of_setting, settings)


@eqx.filter_jit
def on_pools(
    pools: NodePool,
    conditions: Condition,
    setting: Int[Array, " rows"],
    formulation: Formulation,
) -> tuple[Float[Array, " rows"], Float[Array, " rows"], Terms]:
    """Distortions of every row and the terms that matter in it, in chunks."""
    rows, chain = len(setting), CHAIN[formulation]
    chunk = min(_CHUNK, rows)
    moving, fixed = eqx.partition(conditions, lambda x: x.ndim == 1)

    def in_chunks(x: Array) -> Array:
        return jnp.pad(x, (0, -rows % chunk), mode="edge").reshape(-1, chunk)

    @jax.checkpoint
    def of_chunk(part: tuple[Condition, Int[Array, " chunk"]]):
        def each(f):
            own = lambda c, i: f(eqx.combine(c, fixed), i)
            return jax.vmap(own)(*part)

        place, area = chain.replica_place, chain.cell_area
        terms = each(lambda c, i: chain.terms(c))
        still = each(lambda c, i: spatial(pools, i, c, area(c)))
        judder = lambda: each(lambda c, i: temporal(pools, i, c, place(c), area(c)))
        nothing = lambda: jnp.zeros_like(still)
        some = jax.lax.cond(jnp.any(terms.judder), judder, nothing)
        return still, jnp.where(terms.judder, some, 0), terms

    chunks = jax.tree.map(in_chunks, (moving, setting))
    found = jax.lax.map(of_chunk, chunks)
    return jax.tree.map(lambda x: x.reshape(-1)[:rows], found)
