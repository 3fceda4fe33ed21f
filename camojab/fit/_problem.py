"""A fit as a function of the vector that is searched: rows, constants and target."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._condition import Condition
from .._display import Components, Display, Shading, Viewing
from .._newton import Place
from .._parameters import Formulation, Parameters
from .._spectrum import Spectrum
from ._chain import Chain
from ._comparisons import Comparisons
from ._constants import Constants
from ._moments import Moments, moments
from ._observations import Observations
from ._targets import jnd_target, Target, vote_target


Data = Observations | Comparisons
Progress = Callable[[int, int], None]


class Problem(eqx.Module):
    """Everything that a fit depends on but the point of the search."""

    energies: Moments | Chain
    constants: Constants
    target: Target
    reference: Int[Array, " rows"]
    data_set: Int[Array, " rows"]
    temporal_only: Bool[Array, " rows"]

    def quality(self, constants: Constants) -> Float[Array, " rows"]:
        """Of each row relative to its reference. [JND].

        The judder alone is in [JND] per unit of it, so that its scale is its weight.
        """
        p = constants.parameters
        spatial, temporal = self.energies.distortion(p)
        both = p.ws * spatial + p.wt * temporal
        quality = jnp.where(self.temporal_only, -temporal, both)
        scale = constants.scale[self.data_set]
        return scale * (quality - quality[self.reference])

    def residuals(self, point: Float[Array, " free"]) -> Float[Array, " data"]:
        """Half the sum of their squares is to be as small as possible."""
        constants = self.constants.at(point)
        return self.target.residuals(self.quality(constants), constants.lapse)

    def look(self, point: Float[Array, " free"]) -> Place:
        """Value, gradient and expected curvature of half the squared residuals."""
        judged, residuals, slope = self.slope(point)
        weight = self.target.information(judged)
        return Place(
            point,
            0.5 * jnp.sum(residuals**2),
            -slope.T @ self.target.score(judged),
            (slope * weight[:, None]).T @ slope,
        )

    def evidence(self, point: Float[Array, " free"]) -> Float[Array, "data free"]:
        """A root of the expected information matrix."""
        judged, residuals, slope = self.slope(point)
        variance = self.target.variance(residuals, point.size)
        return jnp.sqrt(self.target.information(judged) / variance)[:, None] * slope

    def slope(
        self, point: Float[Array, " free"]
    ) -> tuple[Float[Array, " data"], Float[Array, " data"], Float[Array, "data free"]]:
        """What the data measure, the residuals, and the derivative of the former."""

        def judged(point: Float[Array, " free"]):
            constants = self.constants.at(point)
            quality, lapse = self.quality(constants), constants.lapse
            judged = self.target.judged(quality, lapse)
            return judged, (judged, self.target.residuals(quality, lapse))

        slope, both = jax.jacfwd(judged, has_aux=True)(point)
        return *both, slope

    def log_likelihood(self, point: Float[Array, " free"]) -> Float[Array, ""]:
        return self.target.log_likelihood(self.residuals(point))


def problem(
    data: Data,
    constants: Constants,
    formulation: Formulation,
    components: Components,
    progress: Progress,
) -> Problem:
    """Pool the spectra of all rows, as far as the free constants allow."""
    table: Any = data.table.reset_index(drop=True)
    how = (formulation, components, progress)
    if set(constants.model()) <= {"beta"}:
        energies: Moments | Chain = all_moments(data, constants.parameters, *how)
    else:
        energies = _chain(data, constants.model(), *how)
    if isinstance(data, Observations):
        target: Target = jnd_target(table)
    else:
        target = vote_target(data.votes, np.ones(len(data.votes), bool))
    names = list(constants.data_sets)
    return Problem(
        energies,
        constants,
        target,
        jnp.asarray(table["reference"].to_numpy(np.int32)),
        jnp.asarray([names.index(name) for name in table["data_set"]], jnp.int32),
        jnp.asarray(table["temporal_only"].to_numpy(bool)),
    )


def conditions(table: Any) -> tuple[Display, Viewing, Shading]:
    """The rows of a table as one batch of the model's conditions."""
    column = lambda name: table[name].to_numpy(float)
    return (
        Display(
            ppd=column("ppd"),
            refresh_rate=column("refresh_rate_hz"),
            luminance=column("mean_luminance_cd_m2"),
            persistence=column("persistence"),
        ),
        Viewing(column("velocity_deg_s")),
        Shading(
            rate_x=column("rate_x"),
            rate_y=column("rate_y"),
            mip_level=column("mip_level"),
        ),
    )


def all_moments(
    data: Data,
    parameters: Parameters,
    formulation: Formulation,
    components: Components,
    progress: Progress,
) -> Moments:
    """Moments of every row, whatever its texture."""
    table: Any = data.table.reset_index(drop=True)
    textures = list(dict.fromkeys(table["texture"]))
    parts, rows = [], []
    for done, name in enumerate(textures):
        progress(done, len(textures))
        chosen = table[table["texture"] == name]
        spectrum = Spectrum.from_texture(data.textures[name])
        condition = Condition(*conditions(chosen), components, parameters)
        parts.append(moments(spectrum, condition, formulation=formulation))
        rows.append(chosen.index.to_numpy())
    progress(len(textures), len(textures))
    order = np.argsort(np.concatenate(rows))
    return jax.tree.map(lambda *x: jnp.concatenate(x)[order], *parts)


def _chain(
    data: Data,
    free: tuple[str, ...],
    formulation: Formulation,
    components: Components,
    progress: Progress,
) -> Chain:
    table: Any = data.table.reset_index(drop=True)
    textures = list(dict.fromkeys(table["texture"]))
    spectra = []
    for done, name in enumerate(textures):
        progress(done, len(textures))
        spectra.append(Spectrum.from_texture(data.textures[name]).amplitude)
    progress(len(textures), len(textures))
    pooled = table[["texture", "rate_x", "rate_y", "mip_level"]]
    pool = pooled.groupby(list(pooled), sort=False).ngroup().to_numpy()
    firsts = np.unique(pool, return_index=True)[1]
    display, viewing, _ = conditions(table)
    return Chain(
        jnp.stack(spectra),
        jnp.asarray([textures.index(n) for n in table["texture"].to_numpy()[firsts]]),
        conditions(table.iloc[firsts])[2],
        jnp.asarray(pool),
        display,
        viewing,
        components,
        free,
        formulation,
    )
