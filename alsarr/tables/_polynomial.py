"""Tables as the cheapest rung of the model."""

import equinox as eqx
import jax
import jax.core
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
from ._domain import Conditions
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

    **Raises:** `ValueError` for tables relative to a rate or without some rate, and for
    a texture that is unknown or has no polynomials; when
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
        if _is_absent(tables, texture):
            raise ValueError(
                f"`texture` must be one that the tables have polynomials of, got "
                f"{texture!r}."
            )
        if tables.rates != RATES.names:
            raise ValueError(
                f"`tables` must have the rates {', '.join(RATES.names)}, got "
                f"{', '.join(tables.rates)}."
            )
        self.tables = tables
        self.texture = texture

    def quality(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Float[Array, "..."]:
        """Quality of motion along x. [JND]. The spectrum is not looked at."""
        del spectrum, formulation
        tables, c, shape = self.tables, condition, common_shape(condition)
        within = lambda x, ends: jnp.clip(
            jnp.broadcast_to(x, shape).astype(tables.dtype), *ends
        )
        domain = tables.domain
        light = within(c.display.luminance, domain.luminance)
        at = Conditions(
            within(c.viewing.velocity, domain.velocity),
            within(c.display.refresh_rate, domain.refresh_rate),
            jnp.log10(light),
        )
        coefficients = self._coefficients(c.shading)
        whole = (*shape, coefficients.shape[-1])
        return tables.basis.evaluate(jnp.broadcast_to(coefficients, whole), at, domain)

    def _coefficients(self, s: Shading) -> Float[Array, "*shading c"]:
        """Of every rate and mip level, in their own shape."""
        tables = self.tables
        fields = (s.rate_x, s.rate_y, s.mip_level)
        shape = np.broadcast_shapes(*(x.shape for x in fields))
        rate_x, rate_y, level = (
            jnp.broadcast_to(x, shape).astype(tables.dtype).ravel() for x in fields
        )
        of_all = tables.polynomial(self.texture, level)[:, :, 0]
        rate = _rate(rate_x, rate_y)
        found = jnp.take_along_axis(of_all, rate[:, None, None], axis=1)
        return found.reshape(*shape, -1)

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


def _is_absent(tables: QualityTables, texture: str) -> bool:
    """Whether no polynomials were made of a texture; inside a transformation, no."""
    entry = tables.entry
    if isinstance(entry, jax.core.Tracer):
        return False
    return bool(np.asarray(entry)[tables.texture_names.index(texture), 0] < 0)


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
