"""Energies, distortions and quality of a moving, coarsely shaded texture."""

from types import ModuleType

import equinox as eqx
import jax
from jaxtyping import Array, Float

from . import _paper, _released
from ._condition import Condition, flattened
from ._csf import broadcast
from ._display import Components, Display, Shading, Viewing
from ._parameters import Formulation, Parameters
from ._spectrum import Spectrum


CHAIN: dict[Formulation, ModuleType] = {
    Formulation.RELEASED: _released,
    Formulation.PAPER: _paper,
}


class Distortion(eqx.Module):
    """Visual energy lost and added, in the shape of the conditions. [1].

    - `spatial`: energy that mipmapping, coarse shading and eye blur took from the
      texture; negative where aliases add more than blur removes.
    - `temporal`: energy of the replica that the refresh rate lets through, >= 0.

    **Source:** Jindal et al. 2021, Eq. 21 and 23.
    """

    spatial: Float[Array, "..."]
    temporal: Float[Array, "..."]


def quality(
    spectrum: Spectrum,
    display: Display,
    viewing: Viewing,
    shading: Shading | None = None,
    parameters: Parameters | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
    components: Components | None = None,
) -> Float[Array, "..."]:
    """Quality of a moving texture, 0 where nothing is lost. [JND].

    One JND apart, 75 % of people prefer the better of two conditions.

    **Arguments:** as `distortion`; `ws` and `wt` of `parameters` weigh its two parts.

    **Returns:** quality in the shape that the conditions broadcast to. [JND]. The
    weights are those fitted together with `beta`; a data set's own scale is not
    included.

    **Source:** Jindal et al. 2021, Eq. 1.
    """
    parameters = parameters or Parameters.published(formulation)
    parts = distortion(
        spectrum,
        display,
        viewing,
        shading,
        parameters,
        formulation=formulation,
        components=components,
    )
    ws, wt, spatial, temporal = broadcast(
        parameters.ws, parameters.wt, parts.spatial, parts.temporal
    )
    return ws * spatial + wt * temporal


def distortion(
    spectrum: Spectrum,
    display: Display,
    viewing: Viewing,
    shading: Shading | None = None,
    parameters: Parameters | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
    components: Components | None = None,
) -> Distortion:
    """Spatial and temporal distortion of a moving, coarsely shaded texture.

    The fields of `display`, `viewing`, `shading`, `parameters` and `components` may
    have any shapes that broadcast together; conditions are evaluated one after the
    other, so that memory does not grow with their number, forward or backward. One
    compilation serves all conditions of a shape.

    **Arguments:**

    - `spectrum`: of the texture.
    - `shading`: full rate at mip level 0 if left out.
    - `parameters`: the published ones of `formulation` if left out.
    - `components`: everything if left out.

    **Returns:** the two distortions in the broadcast shape. [1].

    **Raises:** `ValueError` if the shapes of the conditions do not broadcast.

    **Accuracy:** `RELEASED` agrees with the authors' program to a relative error of
    1e-8 in double and 1e-4 in single precision (`tests/test_quality.py`).

    **Source:** Jindal et al. 2021, Eq. 2 to 23.
    """
    condition = Condition(
        display,
        viewing,
        shading or Shading(),
        components or Components(),
        parameters or Parameters.published(formulation),
    )
    shape, condition = flattened(condition, spectrum.amplitude.dtype)
    spatial, temporal = _distortions(spectrum, condition, formulation)
    return Distortion(spatial.reshape(shape), temporal.reshape(shape))


class Pooled(eqx.Module):
    """A texture at one mip level and shading rate, its energies already pooled.

    Made by `pool`. For `RELEASED` it loses nothing, and every further display and
    velocity costs about a tenth of starting from the spectrum.
    """

    energies: _released.ReleasedPool | _paper.PaperPool
    parameters: Parameters
    formulation: Formulation = eqx.field(static=True)


def pool(
    spectrum: Spectrum,
    shading: Shading | None = None,
    parameters: Parameters | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
) -> Pooled:
    """Pool the energies of a texture at one mip level and rate, for `pooled_quality`.

    **Arguments:** as `distortion`; the fields of `shading` and `parameters` are scalars
    here, and `vmap` serves several.
    """
    return _pool(
        spectrum,
        shading or Shading(),
        parameters or Parameters.published(formulation),
        formulation,
    )


@eqx.filter_jit
def _pool(
    spectrum: Spectrum,
    shading: Shading,
    parameters: Parameters,
    formulation: Formulation,
) -> Pooled:
    amplitude = spectrum.amplitude
    same = lambda tree: jax.tree.map(lambda x: x.astype(amplitude.dtype), tree)
    shading, parameters = same(shading), same(parameters)
    chain, components = CHAIN[formulation], Components()
    energies = chain.pool(amplitude, shading, components, parameters)
    return Pooled(energies, parameters, formulation)


@eqx.filter_jit
def pooled_quality(
    pooled: Pooled, display: Display, viewing: Viewing
) -> Float[Array, "..."]:
    """`quality` of a pooled texture. [JND].

    **Arguments:** `display` and `viewing` as `distortion`, of shapes that broadcast.

    **Returns:** quality in the broadcast shape. [JND].
    """
    chain, parameters = CHAIN[pooled.formulation], pooled.parameters
    condition = Condition(display, viewing, Shading(), Components(), parameters)
    shape, conditions = flattened(condition, parameters.beta.dtype)

    @jax.checkpoint
    def one(c: Condition) -> Array:
        spatial, temporal = chain.evaluate(pooled.energies, c)
        return c.parameters.ws * spatial + c.parameters.wt * temporal

    return jax.lax.map(one, conditions).reshape(shape)


@eqx.filter_jit
def _distortions(
    spectrum: Spectrum, conditions: Condition, formulation: Formulation
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    chain = CHAIN[formulation]

    # Checkpointed, or the backward pass would keep every condition's spectra.
    @jax.checkpoint
    def one(c: Condition):
        parts = c.shading, c.components, c.parameters
        return chain.evaluate(chain.pool(spectrum.amplitude, *parts), c)

    return jax.lax.map(one, conditions)
