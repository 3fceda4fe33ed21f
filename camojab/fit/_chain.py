"""Distortions of many rows as functions of any of the model's constants.

Only `beta` and `mipmap_width` act on what is pooled of a texture; every other constant
acts on the few thousand numbers that pooling leaves. The Jacobian is formed in these
two parts, once a point, and serves forward and reverse mode alike.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._chains import CHAIN
from .._condition import Condition
from .._display import Components, Display, Shading, Viewing
from .._parameters import Formulation, Parameters


_POOLED = ("beta", "mipmap_width")


class Chain(eqx.Module):
    """Textures and conditions; `texture` and `shading` have an entry for each pool.

    A pool is a texture at one mip level and rate, `pool` the one of each row.
    """

    amplitude: Float[Array, "textures 512 512"]
    texture: Int[Array, " pools"]
    shading: Shading
    pool: Int[Array, " rows"]
    display: Display
    viewing: Viewing
    components: Components
    free: tuple[str, ...] = eqx.field(static=True)
    formulation: Formulation = eqx.field(static=True)

    def distortion(
        self, parameters: Parameters
    ) -> tuple[Float[Array, " rows"], Float[Array, " rows"]]:
        """Spatial and temporal distortion. [1]. Differentiable once in `free`."""
        values = jnp.stack([getattr(parameters, name) for name in self.free])
        held = jax.lax.stop_gradient(parameters)
        return _distortion(values, (self, held))


@eqx.filter_custom_jvp
def _distortion(values: Float[Array, " free"], fixed: tuple[Chain, Parameters]):
    chain, held = fixed
    return _evaluated(chain, _pools(chain, held, values), held, values)


@_distortion.def_jvp
def _distortion_jvp(primals, tangents):
    (values, (chain, held)), (along, _) = primals, tangents
    out, (spatial, temporal) = _jacobian(chain, held, values)
    along = jnp.zeros_like(values) if along is None else along
    return out, (spatial @ along, temporal @ along)


def _jacobian(chain: Chain, held: Parameters, values: Float[Array, " free"]):
    """Distortions, and the derivative of both with respect to the values."""
    at = np.array([i for i, name in enumerate(chain.free) if name in _POOLED], int)

    def through(part: Float[Array, " pooled"]):
        pools = _pools(chain, held, values.at[at].set(part))
        return _evaluated(chain, pools, held, values), pools

    def beside(values: Float[Array, " free"], pools):
        return _evaluated(chain, pools, held, values)

    if not at.size:
        pools = _pools(chain, held, values)
        return beside(values, pools), jax.jacfwd(beside)(values, pools)
    more, pools = jax.jacfwd(through, has_aux=True)(values[at])
    jacobian = jax.jacfwd(beside)(values, pools)
    jacobian = jax.tree.map(lambda j, m: j.at[:, at].add(m), jacobian, more)
    return beside(values, pools), jacobian


def _with(
    held: Parameters, free: tuple[str, ...], values: Float[Array, " free"]
) -> Parameters:
    where = lambda p: [getattr(p, name) for name in free]
    return eqx.tree_at(where, held, list(values))


def _pools(chain: Chain, held: Parameters, values: Float[Array, " free"]):
    parameters = _with(held, chain.free, values)
    pooled = CHAIN[chain.formulation].pool

    def one(at):
        texture, shading = at
        amplitude = chain.amplitude[texture]
        return pooled(amplitude, shading, chain.components, parameters)

    return jax.lax.map(one, (chain.texture, chain.shading))


def _evaluated(chain: Chain, pools, held: Parameters, values: Float[Array, " free"]):
    parameters = _with(held, chain.free, values)

    def one(row):
        pool, display, viewing = row
        energies = jax.tree.map(lambda x: x[pool], pools)
        shading = jax.tree.map(lambda x: x[pool], chain.shading)
        c = Condition(display, viewing, shading, chain.components, parameters)
        return CHAIN[chain.formulation].evaluate(energies, c)[:2]

    return jax.lax.map(one, (chain.pool, chain.display, chain.viewing))
