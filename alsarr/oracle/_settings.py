"""The model's energies of every pair of texture and mip level, ready to be judged.

A setting is what energies are pooled for: a pair, a shading rate and a direction of
motion. Those of one pair are judged together, for a block of tiles at a time.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PyTree

from camojab import (
    Display,
    Exact,
    Formulation,
    Parameters,
    pool,
    Pooled,
    pooled_quality,
    PooledTexture,
    Shading,
    Spectrum,
    Viewing,
)

from .._rates import RATES


if TYPE_CHECKING:
    from typing import ClassVar as AbstractClassVar
else:
    from equinox import AbstractClassVar


class AbstractSettings(eqx.Module, strict=True):
    """All settings of some pairs of texture and mip level.

    - `block`: tiles that are best judged together.
    """

    block: AbstractClassVar[int]

    @property
    @abstractmethod
    def pairs(self) -> int:
        """How many there are."""

    @abstractmethod
    def quality(
        self,
        pair: Int[Array, ""],
        display: Display,
        viewing: Viewing,
        parameters: Parameters,
        formulation: Formulation,
    ) -> Float[Array, "2 7 tiles"]:
        """Quality in both directions at every rate. [JND].

        **Arguments:** `display`: `luminance` one a tile; `viewing`: [2, tiles].
        """


class ExactSettings(AbstractSettings, strict=True):
    """Spectra alone: energies are pooled anew for every block, setting by setting."""

    amplitude: Float[Array, "textures 512 512"]
    texture: Int[Array, " pairs"]
    mip_level: Float[Array, " pairs"]

    # Pooling one setting takes as long as some twenty tiles.
    block: ClassVar[int] = 16

    @property
    def pairs(self) -> int:
        return self.texture.size

    def quality(
        self,
        pair: Int[Array, ""],
        display: Display,
        viewing: Viewing,
        parameters: Parameters,
        formulation: Formulation,
    ) -> Float[Array, "2 7 tiles"]:
        """See `AbstractSettings.quality`."""

        def one(spectrum: Spectrum, shading: Shading, viewing: Viewing) -> Array:
            pooled = pool(spectrum, shading, parameters, formulation=formulation)
            return pooled_quality(pooled, display, viewing)

        amplitude = self.amplitude[self.texture[pair]]
        return _each_setting(one, amplitude, self.mip_level[pair], viewing)


class PooledSettings(AbstractSettings, strict=True):
    """Energies on nodes, of every setting.

    - `energies`: a pool whose arrays are [pairs, 2, 7, ...], without its nodes.
    - `nodes`: the rest of that pool, which is the same for all settings, so that what
        depends on nodes and conditions alone is evaluated once a tile.
    """

    energies: PyTree[Array]
    nodes: PyTree[Array]

    # Measured: half as many take half as long again, twice as many no less time.
    block: ClassVar[int] = 64

    @property
    def pairs(self) -> int:
        return jax.tree.leaves(self.energies)[0].shape[0]

    def quality(
        self,
        pair: Int[Array, ""],
        display: Display,
        viewing: Viewing,
        parameters: Parameters,
        formulation: Formulation,
    ) -> Float[Array, "2 7 tiles"]:
        """See `AbstractSettings.quality`."""

        def one(energies: PyTree[Array], viewing: Viewing) -> Array:
            whole = eqx.combine(energies, self.nodes)
            pooled = PooledTexture(whole, parameters, formulation)
            return pooled_quality(pooled, display, viewing)

        own = jax.tree.map(lambda x: x[pair], self.energies)
        return jax.vmap(jax.vmap(one, (0, None)))(own, viewing)


def settings(
    spectra: Sequence[Spectrum],
    pairs: Sequence[tuple[int, float]],
    parameters: Parameters,
    formulation: Formulation,
    fidelity: Exact | Pooled,
) -> AbstractSettings:
    """What `fidelity` judges the pairs of texture index and mip level [octaves] from.

    `spectra` and `parameters` are of one floating dtype.
    """
    dtype = spectra[0].amplitude.dtype
    levels = jnp.asarray([level for _, level in pairs], dtype)
    if isinstance(fidelity, Exact):
        amplitude = jnp.stack([spectrum.amplitude for spectrum in spectra])
        return ExactSettings(amplitude, jnp.asarray([t for t, _ in pairs]), levels)
    textures = [spectra[texture].amplitude for texture, _ in pairs]
    every = [
        _pooled(amplitude, level, parameters, formulation, fidelity)
        for amplitude, level in zip(textures, levels, strict=True)
    ]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *every)
    of_nodes = lambda pool: (pool.radial, pool.along, pool.places)
    each = jax.tree.map(lambda _: True, stacked)
    energies, nodes = eqx.partition(
        stacked, eqx.tree_at(of_nodes, each, (False, False, False))
    )
    return PooledSettings(energies, jax.tree.map(lambda x: x[0, 0, 0], nodes))


@eqx.filter_jit
def _pooled(
    amplitude: Float[Array, "512 512"],
    mip_level: Float[Array, ""],
    parameters: Parameters,
    formulation: Formulation,
    fidelity: Pooled,
):
    def one(spectrum: Spectrum, shading: Shading, _: None):
        how = {"formulation": formulation, "fidelity": fidelity}
        return pool(spectrum, shading, parameters, **how).energies

    return _each_setting(one, amplitude, mip_level, None)


def _each_setting(
    of: Callable[[Spectrum, Shading, Any], Any],
    amplitude: Float[Array, "512 512"],
    mip_level: Float[Array, ""],
    by_direction: Any,
) -> Any:
    """Along x, then along y: the transposed texture, the sides swapped (Eq. 28).

    One after another, so that memory holds one setting's spectra. The arrays of
    `by_direction` have an axis of 2 for the directions.
    """
    sides = jnp.asarray(RATES.resolution, amplitude.dtype)

    def along(direction) -> Any:
        amplitude, sides, more = direction

        def at(side: Float[Array, "2"]) -> Any:
            shading = Shading(rate_x=side[0], rate_y=side[1], mip_level=mip_level)
            return of(Spectrum(amplitude), shading, more)

        return jax.lax.map(at, sides)

    textures = jnp.stack([amplitude, amplitude.T])
    both = jnp.stack([sides, sides[:, ::-1]])
    return jax.lax.map(along, (textures, both, by_direction))
