"""Tables as the cheapest rung of the model."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from camojab import (
    AbstractFidelity,
    Distortion,
    Formulation,
    Pooled,
    Shading,
    Spectrum,
)
from camojab._batch import batch, sampled
from camojab._condition import common_shape, Condition
from camojab._errors import check
from camojab._fidelity import SAFETY

from .._rates import RATES
from ._eq31 import evaluate_eq31
from ._tables import QualityTables


class Polynomial(eqx.Module, AbstractFidelity):
    """Quality from a table: the fastest of the model's rungs, and the coarsest.

    A table knows one display's `ppd` and `persistence` and one set of constants; those
    of a call are not looked at. Velocity, refresh rate and luminance outside of the
    table's domain are moved to its edge, and the nearest mip level is taken. What all
    that costs is in `error_jnd`, which compares with the call's own conditions.

    **Arguments:**

    - `tables`: of the model's own quality (`relative_to` is `None`).
    - `texture`: the name of one of their textures.

    **Raises:** `ValueError` for tables relative to a rate, or an unknown texture; when
    used, for a shading rate that is none of `alsarr.RATES`.
    """

    tables: QualityTables
    texture: str = eqx.field(static=True)

    def __init__(self, tables: QualityTables, texture: str):
        if tables.relative_to is not None:
            raise ValueError(
                "`tables` must be relative to no rate, got tables relative to "
                f"{tables.relative_to}."
            )
        if texture not in tables.texture_names:
            raise ValueError(
                f"`texture` must be one of {', '.join(tables.texture_names)}, got "
                f"{texture!r}."
            )
        self.tables = tables
        self.texture = texture

    def quality(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Float[Array, "..."]:
        """Quality of motion along x. [JND]. The spectrum is not looked at."""
        del spectrum, formulation
        tables, c, shape = self.tables, condition, common_shape(condition)
        clipped = lambda x, ends: jnp.clip(
            jnp.broadcast_to(x, shape).astype(tables.dtype), *ends
        )
        domain = tables.domain
        light = clipped(c.display.luminance, 10**domain.log10_luminance)
        return evaluate_eq31(
            jnp.broadcast_to(self._coefficients(c.shading), (*shape, 10)),
            clipped(c.viewing.velocity, domain.velocity),
            clipped(c.display.refresh_rate, domain.refresh_rate),
            jnp.log10(light),
        )

    def _coefficients(self, s: Shading) -> Float[Array, "*shading 10"]:
        """Of every rate and mip level, in their own shape."""
        tables = self.tables
        fields = (s.rate_x, s.rate_y, s.mip_level)
        shape = np.broadcast_shapes(*(x.shape for x in fields))
        rate_x, rate_y, level = (
            jnp.broadcast_to(x, shape).astype(tables.dtype).ravel() for x in fields
        )
        nearest = jnp.argmin(jnp.abs(tables.mip_levels[:, None] - level[None]), axis=0)
        texture = tables.texture_names.index(self.texture)
        found = tables.coefficients[texture, nearest, _rate(rate_x, rate_y), 0]
        return found.reshape(*shape, 10)

    def distortion(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Distortion:
        """Tables hold no distortions: always a `ValueError`."""
        raise ValueError(
            "`fidelity` must be a rung that has distortions, since tables hold quality "
            "alone, got Polynomial."
        )

    def error_jnd(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> float:
        """Half as much again as the largest difference to the pooled model. [JND]."""
        some = sampled(batch(condition, spectrum.amplitude.dtype)).conditions
        model = Pooled(10_000)
        ours = self.quality(spectrum, some, formulation)
        theirs = model.quality(spectrum, some, formulation)
        error = jnp.max(jnp.abs(ours - theirs.astype(ours.dtype)), initial=0.0)
        return SAFETY * float(error) + model.error_jnd(spectrum, some, formulation)


def _rate(rate_x: Float[Array, " n"], rate_y: Float[Array, " n"]) -> Array:
    """Index into `RATES`."""
    known = jnp.asarray(RATES.resolution, rate_x.dtype)
    asked = jnp.stack([rate_x, rate_y], axis=1)
    same = jnp.all(asked[:, None, :] == known[None], axis=2)
    names = ", ".join(RATES.names)
    of = jnp.where(jnp.any(same, axis=1), jnp.argmax(same, axis=1), -1)
    checked = check(
        "shading",
        of.astype(rate_x.dtype),
        lambda index: index >= 0,
        f"at one of the rates {names}",
    )
    return jax.lax.stop_gradient(checked).astype(int)
