import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._rates import RATES
from ._eq31 import evaluate_eq31
from ._tables import AbstractTables


_LAST_LEVEL = 11


class TablesJindal2021(AbstractTables, strict=True):
    """The tables that Jindal et al. (2021) published, evaluated as their program does.

    One polynomial for half and one for full shading resolution along an axis, relative
    to a quarter, whose quality is 0. The quality of a tile is the mean of both axes,
    each at its own velocity, plus 0.1 JND: their greedy solver is helped by ratios
    that are not 0. The logarithm is taken of the luminance plus 0.01 cd/m^2.
    Conditions outside those fitted (velocity 0 to 50 deg/s, refresh rate 30 to 120 Hz,
    luminance 0.1 to 316 cd/m^2) are extrapolated; mip levels are limited to 0 to 11.

    - `coefficients`: axes material, mip level from 0, (half, full), $W_0$ to $W_9$.
    - `material_names`: one name a material.

    **Raises:** `ValueError` if the shape of the coefficients does not match the names.

    **Source:** Jindal et al. (2021), ACM Trans. Graph. 40(6), Section 5.3, and the
    program and tables published with it (gfxdisp/ALSaRR at d06b3e0).
    """

    coefficients: Float[Array, "materials 12 2 10"]
    material_names: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, coefficients: ArrayLike, material_names: tuple[str, ...]):
        coefficients = jnp.asarray(coefficients, jnp.result_type(float))
        shape = (len(material_names), _LAST_LEVEL + 1, 2, 10)
        if coefficients.shape != shape:
            raise ValueError(
                f"`coefficients` must have shape {shape} to match the names of the "
                f"materials, got {coefficients.shape}."
            )
        self.coefficients = coefficients
        self.material_names = material_names

    @property
    def num_textures(self) -> int:
        return self.coefficients.shape[0]

    @property
    def dtype(self) -> jnp.dtype:
        return self.coefficients.dtype

    def holds(self, texture: Int[Array, " tiles"]) -> Bool[Array, " tiles"]:
        """See `AbstractTables.holds`."""
        return texture < self.num_textures

    def quality(
        self,
        texture: Int[Array, " tiles"],
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Float[Array, "tiles 7"]:
        """See `AbstractTables.quality`. Differentiable in all but the indices."""
        level = jnp.clip(jnp.ceil(mip_level - 0.5), 0, _LAST_LEVEL).astype(int)
        half_and_full = evaluate_eq31(
            self.coefficients[texture, level][:, None],
            jnp.stack([velocity_x, velocity_y], axis=1)[:, :, None],
            refresh_rate[None, None, None],
            jnp.log10(luminance + 0.01)[:, None, None],
        )
        by_step = jnp.pad(half_and_full, ((0, 0), (0, 0), (1, 0)))
        steps = 2 - np.log2(RATES.size).astype(int)
        both = by_step[:, 0, steps[:, 0]] + by_step[:, 1, steps[:, 1]]
        return both / 2 + 0.1

    def outside(
        self,
        texture: Int[Array, " tiles"],
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Bool[Array, " tiles"]:
        """See `AbstractTables.outside`. The qualities of these tiles extrapolate."""
        del texture
        return (
            (mip_level > _LAST_LEVEL)
            | (velocity_x > 50)
            | (velocity_y > 50)
            | (luminance < 0.1)
            | (luminance > 10**2.5)
            | (refresh_rate < 30)
            | (refresh_rate > 120)
        )
