from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from .._rates import RATES
from ._eq31 import evaluate_eq31, fit_eq31


class AbstractTables(eqx.Module, strict=True):
    """Polynomials that give the quality of every shading rate under given conditions.

    Tables know textures, conditions and polynomials; a frame is looked up in them by
    `alsarr.oracle.TableOracle`. All arrays of the methods have one entry a tile and
    the floating dtype of the coefficients:

    - `texture`: index into the tables. In [0, `num_textures`).
    - `mip_level`: [octaves], >= 0. The nearest level of the tables is used, the
        finer of two.
    - `velocity_x`, `velocity_y`: [deg/s], >= 0.
    - `luminance`: [cd/m^2], >= 0.
    - `refresh_rate`: one number for all. [Hz], > 0.
    """

    @property
    @abstractmethod
    def num_textures(self) -> int:
        """How many textures the tables hold."""

    @property
    @abstractmethod
    def dtype(self) -> jnp.dtype:
        """Floating dtype of the coefficients, and so of the qualities."""

    @abstractmethod
    def quality(
        self,
        texture: Int[Array, " tiles"],
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Float[Array, "tiles 7"]:
        """Quality of each rate, in the order of `alsarr.RATES`. [JND]"""

    @abstractmethod
    def outside(
        self,
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Bool[Array, " tiles"]:
        """Whether the tables were not fitted to such conditions."""


_Ends = tuple[float | int, float | int]


class Domain(eqx.Module, strict=True):
    """Lowest and highest condition that polynomials were fitted to.

    - `velocity`: [deg/s].
    - `refresh_rate`: [Hz].
    - `log10_luminance`: [log10(cd/m^2)].
    """

    velocity: Float[Array, "2"]
    refresh_rate: Float[Array, "2"]
    log10_luminance: Float[Array, "2"]

    def __init__(
        self,
        *,
        velocity: ArrayLike | _Ends,
        refresh_rate: ArrayLike | _Ends,
        log10_luminance: ArrayLike | _Ends,
    ):
        dtype = jnp.result_type(float)
        self.velocity = jnp.asarray(velocity, dtype)
        self.refresh_rate = jnp.asarray(refresh_rate, dtype)
        self.log10_luminance = jnp.asarray(log10_luminance, dtype)


class QualityTables(AbstractTables, strict=True):
    """Eq. 31 for every texture, mip level, shading rate and direction of motion.

    Direction 0 is motion in x over the texture as it is; direction 1 is motion in y,
    that is motion in x over the transposed texture with the sides of the coarse pixel
    swapped (Eq. 28). The quality of a tile is the mean of both (Eq. 29), relative to
    shading the same texture under the same condition at the rate `relative_to`.

    Conditions outside `domain`, and mip levels outside `mip_levels`, are moved to its
    edge; `outside` tells which.

    - `coefficients`: $W_0$ to $W_9$ in the units of `evaluate_eq31`.
    - `mip_levels`: the levels of the second axis, rising. [octaves]
    - `domain`: the conditions that were fitted.
    - `largest_error`, `median_error`: of the absolute errors against the model, over
        all fitted conditions of every rate but 4x4. [JND]
    - `texture_names`: one name a texture.
    - `model`: one line that says which model and display the qualities come from.
    - `relative_to`: name of the rate whose quality is 0; `None` where qualities are the
      model's own.

    **Raises:** `ValueError` if the shape of the coefficients does not match the names
    and levels, or the levels do not rise.

    **Source:** Jindal et al. (2021), ACM Trans. Graph. 40(6), Eqs. 28, 29 and 31.
    """

    coefficients: Float[Array, "textures mips 7 2 10"]
    mip_levels: Float[Array, " mips"]
    domain: Domain
    largest_error: Float[Array, ""]
    median_error: Float[Array, ""]
    texture_names: tuple[str, ...] = eqx.field(static=True)
    model: str = eqx.field(static=True)
    relative_to: str | None = eqx.field(static=True)

    def __init__(
        self,
        *,
        coefficients: ArrayLike,
        mip_levels: tuple[float | int, ...],
        domain: Domain,
        largest_error: ArrayLike,
        median_error: ArrayLike,
        texture_names: tuple[str, ...],
        model: str,
        relative_to: str | None = "4x4",
    ):
        dtype = jnp.result_type(float)
        coefficients = jnp.asarray(coefficients, dtype)
        shape = (len(texture_names), len(mip_levels), len(RATES), 2, 10)
        if coefficients.shape != shape:
            raise ValueError(
                f"`coefficients` must have shape {shape} to match the names of the "
                f"textures and the mip levels, got {coefficients.shape}."
            )
        if sorted(set(mip_levels)) != list(mip_levels) or not mip_levels:
            raise ValueError(
                f"`mip_levels` must be one or more, rising, got {mip_levels}."
            )
        self.coefficients = coefficients
        self.mip_levels = jnp.asarray(mip_levels, dtype)
        self.domain = domain
        self.largest_error = jnp.asarray(largest_error, dtype)
        self.median_error = jnp.asarray(median_error, dtype)
        self.texture_names = texture_names
        self.model = model
        self.relative_to = relative_to

    @property
    def num_textures(self) -> int:
        return self.coefficients.shape[0]

    @property
    def dtype(self) -> jnp.dtype:
        return self.coefficients.dtype

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
        level = jnp.argmin(jnp.abs(self.mip_levels[:, None] - mip_level[None]), axis=0)
        velocity = jnp.clip(
            jnp.stack([velocity_x, velocity_y], 1), *self.domain.velocity
        )
        log_light = jnp.log10(jnp.clip(luminance, *10**self.domain.log10_luminance))
        by_direction = evaluate_eq31(
            self.coefficients[texture, level],
            velocity[:, None, :],
            jnp.clip(refresh_rate, *self.domain.refresh_rate)[None, None, None],
            log_light[:, None, None],
        )
        return jnp.mean(by_direction, axis=-1)

    def outside(
        self,
        mip_level: Float[Array, " tiles"],
        velocity_x: Float[Array, " tiles"],
        velocity_y: Float[Array, " tiles"],
        luminance: Float[Array, " tiles"],
        refresh_rate: Float[Array, ""],
    ) -> Bool[Array, " tiles"]:
        """See `AbstractTables.outside`. The qualities of these tiles are those of the
        nearest condition inside."""
        domain = self.domain
        return (
            _is_outside(mip_level, self.mip_levels[jnp.array([0, -1])])
            | _is_outside(velocity_x, domain.velocity)
            | _is_outside(velocity_y, domain.velocity)
            | _is_outside(luminance, 10**domain.log10_luminance)
            | _is_outside(refresh_rate, domain.refresh_rate)
        )


def _is_outside(x: Float[Array, "*n"], ends: Float[Array, "2"]) -> Bool[Array, "*n"]:
    """Rounding of the ends themselves, as in 10^log10(L), does not count."""
    slack = 8 * jnp.finfo(ends.dtype).eps * jnp.max(jnp.abs(ends))
    return (x < ends[0] - slack) | (x > ends[1] + slack)


_fit_all = eqx.filter_jit(jax.vmap(fit_eq31, in_axes=(None, None, None, 0)))


def fit_tables(
    velocity: Float[Array, " n"],
    refresh_rate: Float[Array, " n"],
    log10_luminance: Float[Array, " n"],
    quality: Float[Array, "textures mips 7 2 n"],
    *,
    mip_levels: tuple[float | int, ...],
    texture_names: tuple[str, ...],
    model: str,
    relative_to: str | None = "4x4",
) -> QualityTables:
    """Fit Eq. 31 to sampled qualities, all textures, mip levels and rates at once.

    **Arguments:**

    - `velocity`, `refresh_rate`, `log10_luminance`: the sampled conditions, as for
        `fit_eq31`. Their extremes become the domain of the tables.
    - `quality`: the model's quality at them, relative to `relative_to`. [JND]. Axes as
        in `QualityTables`.
    - `mip_levels`, `texture_names`, `model`, `relative_to`: as in `QualityTables`.

    **Returns:** `QualityTables` with their largest and median error.

    **Raises:** as `fit_eq31` and `QualityTables`.
    """
    flat = quality.reshape(-1, quality.shape[-1])
    found = _fit_all(velocity, refresh_rate, log10_luminance, flat)
    coefficients = found.coefficients.reshape(*quality.shape[:4], 10)
    axes = (None,) * 4
    fitted = evaluate_eq31(
        coefficients[..., None, :],
        velocity[axes],
        refresh_rate[axes],
        log10_luminance[axes],
    )
    # The rate that the others are relative to is fitted exactly, by 0.
    free = [name != relative_to for name in RATES.names]
    error = jnp.abs(fitted - quality)[:, :, np.array(free)]
    ends = lambda x: jnp.stack([jnp.min(x), jnp.max(x)])
    return QualityTables(
        coefficients=coefficients,
        mip_levels=mip_levels,
        domain=Domain(
            velocity=ends(velocity),
            refresh_rate=ends(refresh_rate),
            log10_luminance=ends(log10_luminance),
        ),
        largest_error=jnp.max(error),
        median_error=jnp.median(error),
        texture_names=texture_names,
        model=model,
        relative_to=relative_to,
    )
