"""The model sampled for tables: every texture, mip level, rate and direction."""

from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from camojab import (
    Display,
    Formulation,
    Parameters,
    pool,
    pooled_quality,
    Shading,
    Spectrum,
    Viewing,
)

from .._rates import RATES
from ._tables import fit_tables, QualityTables


class Grid(eqx.Module, strict=True):
    """Conditions that a model is sampled at for tables, the product of three lists.

    The defaults are those of the authors' program (gfxdisp/ALSaRR d06b3e0).

    - `velocity`: [deg/s], >= 0.
    - `refresh_rate`: [Hz], > 0.
    - `log10_luminance`: [log10(cd/m^2)].
    """

    velocity: tuple[float, ...] = (0.0, 10.0, 20.0, 30.0, 40.0, 50.0)
    refresh_rate: tuple[float, ...] = (30.0, 45.0, 60.0, 75.0, 90.0, 105.0, 120.0)
    log10_luminance: tuple[float, ...] = (-1.0, 1.0, 2.0, 2.5)

    def samples(self) -> tuple[Float[Array, " n"], ...]:
        """Velocity, refresh rate and log luminance of each sample."""
        axes = (self.velocity, self.refresh_rate, self.log10_luminance)
        mesh = np.meshgrid(*axes, indexing="ij")
        return tuple(jnp.asarray(x.ravel(), float) for x in mesh)


def distil(
    textures: Mapping[str, Spectrum],
    *,
    mip_levels: tuple[float | int, ...],
    ppd: float,
    persistence: float = 1.0,
    parameters: Parameters | None = None,
    formulation: Formulation = Formulation.RELEASED,
    grid: Grid | None = None,
    relative_to: str | None = "4x4",
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> QualityTables:
    """Fit Eq. 31 to the model for every texture, mip level, rate and direction.

    **Arguments:**

    - `textures`: spectra by name, in the order of the frame's texture indices.
    - `mip_levels`: rising; those that the frames need.
    - `ppd` [px/deg] and `persistence` [1] of the display that the tables are for.
    - `parameters`: of the model; the published ones of `formulation` if left out.
    - `grid`: conditions to sample.
    - `relative_to`: name of the rate that the others are relative to; `None` for the
      model's own quality, which `Polynomial` needs.
    - `progress`: called with the (texture, mip level) pairs done and their number.

    **Returns:** tables of quality with their errors on the sampled conditions.

    **Raises:** `ValueError` if there is no texture, no rising list of mip levels, or no
    rate of that name; as
    `Display` and `Shading`.

    **Source:** Jindal et al. 2021, Eq. 28, 29 and 31.
    """
    if not textures:
        raise ValueError("`textures` must have at least one texture, got none.")
    if not mip_levels or sorted(set(mip_levels)) != list(mip_levels):
        raise ValueError(f"`mip_levels` must be one or more, rising, got {mip_levels}.")
    if relative_to not in (*RATES.names, None):
        raise ValueError(
            f"`relative_to` must be one of {', '.join(RATES.names)} or None, got "
            f"{relative_to!r}."
        )
    parameters = parameters or Parameters.published(formulation)
    velocity, refresh_rate, log10_luminance = (grid or Grid()).samples()
    display = Display(
        ppd=ppd,
        refresh_rate=refresh_rate,
        luminance=10.0**log10_luminance,
        persistence=persistence,
    )
    viewing = Viewing(velocity)
    total = len(textures) * len(mip_levels)
    sampled = []
    for spectrum in textures.values():
        for level in mip_levels:
            progress(len(sampled), total)
            both = (
                _at_rates(s, rates, level, display, viewing, parameters, formulation)
                for s, rates in (
                    (spectrum, RATES.resolution),
                    (spectrum.transposed(), RATES.resolution[:, ::-1]),
                )
            )
            sampled.append(jnp.stack(list(both), axis=1))
    progress(total, total)
    shape = (len(textures), len(mip_levels), len(RATES), 2, velocity.size)
    quality = jnp.stack(sampled).reshape(shape)
    if relative_to is not None:
        at = RATES.names.index(relative_to)
        quality = quality - quality[:, :, at : at + 1]
    return fit_tables(
        velocity,
        refresh_rate,
        log10_luminance,
        quality,
        mip_levels=mip_levels,
        texture_names=tuple(textures),
        model=_model_line(display, parameters, formulation),
        relative_to=relative_to,
    )


def _at_rates(
    spectrum: Spectrum,
    resolution: np.ndarray,
    mip_level: float | int,
    display: Display,
    viewing: Viewing,
    parameters: Parameters,
    formulation: Formulation,
) -> Float[Array, "7 n"]:
    """Quality of every rate under every condition. [JND]."""
    shading = Shading(
        rate_x=resolution[:, 0],
        rate_y=resolution[:, 1],
        mip_level=np.full(len(RATES), float(mip_level)),
    )
    return _sample(spectrum, shading, display, viewing, parameters, formulation)


@eqx.filter_jit
def _sample(
    spectrum: Spectrum,
    shading: Shading,
    display: Display,
    viewing: Viewing,
    parameters: Parameters,
    formulation: Formulation,
) -> Float[Array, "7 n"]:
    def one(rate: Shading) -> Float[Array, " n"]:
        pooled = pool(spectrum, rate, parameters, formulation=formulation)
        return pooled_quality(pooled, display, viewing)

    return jax.lax.map(one, shading)


def _model_line(
    display: Display, parameters: Parameters, formulation: Formulation
) -> str:
    return f"camojab {formulation.value}; {display.report()}; {parameters.report()}"
