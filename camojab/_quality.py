"""Energies, distortions and quality of a moving, coarsely shaded texture."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._auto import Auto
from ._batch import batch
from ._chains import CHAIN
from ._condition import Condition, flattened
from ._display import Components, Display, Shading, Viewing
from ._exact import Exact
from ._fidelity import AbstractFidelity, Distortion
from ._node_pool import NodePool
from ._paper import PaperPool
from ._parameters import Formulation, Parameters
from ._pooled import on_pools, pool_on_nodes, Pooled
from ._released import ReleasedPool
from ._spectrum import Spectrum


def quality(
    spectrum: Spectrum,
    display: Display,
    viewing: Viewing,
    shading: Shading | None = None,
    parameters: Parameters | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
    components: Components | None = None,
    fidelity: AbstractFidelity | None = None,
) -> Float[Array, "..."]:
    """Quality of a moving texture, 0 where as much is seen as the texture has. [JND].

    One JND apart, 75 % of people prefer the better of two conditions. What aliases add
    counts as seen, so that the released formulation can give more than 0.

    **Arguments:** as `distortion`; `ws` and `wt` of `parameters` weigh its two parts.

    **Returns:** quality in the shape that the conditions broadcast to. [JND]. The
    weights are those fitted together with `beta`; a data set's own scale is not
    included.

    **Source:** Jindal et al. 2021, Eq. 1.

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from camojab import Display, quality, Shading, Spectrum, Viewing
    >>> noise = np.random.default_rng(0).uniform(size=(512, 512))
    >>> display = Display(ppd=60, refresh_rate=120, luminance=100)
    >>> moving = Viewing(jnp.array([0.0, 10.0, 30.0]))  # [deg/s]
    >>> coarse = Shading(rate_x=0.5)
    >>> jnd = quality(Spectrum.from_texture(noise), display, moving, coarse)
    >>> print(np.asarray(jnd).round(1))
    [-18.3 -23.  -30.1]
    """
    _check_precision(spectrum)
    condition = _condition(
        display, viewing, shading, parameters, formulation, components
    )
    return (fidelity or Exact()).quality(spectrum, condition, formulation)


def distortion(
    spectrum: Spectrum,
    display: Display,
    viewing: Viewing,
    shading: Shading | None = None,
    parameters: Parameters | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
    components: Components | None = None,
    fidelity: AbstractFidelity | None = None,
) -> Distortion:
    """Spatial and temporal distortion of a moving, coarsely shaded texture.

    The fields of `display`, `viewing`, `shading`, `parameters` and `components` may
    have any shapes that broadcast together. Memory does not grow with their number but
    for the result, forward or backward, and one compilation serves all conditions of
    the same shapes. What few conditions share is best left in a smaller shape: energies
    are pooled once for every element of the shape of `shading` and `beta` alone.

    **Arguments:**

    - `spectrum`: of the texture.
    - `shading`: full rate at mip level 0 if left out.
    - `parameters`: the published ones of `formulation` if left out.
    - `components`: everything if left out.
    - `fidelity`: `Exact()` if left out; `Pooled` and `Auto` trade accuracy for time.

    **Returns:** the two distortions in the broadcast shape. [1]. The dtype is that of
    the spectrum.

    **Raises:** `ValueError` if the shapes of the conditions do not broadcast, or if the
    spectrum is in a precision below single.

    **Accuracy:** `Exact()` of `RELEASED` agrees with the authors' program to a relative
    error of 1e-8 in double and 1e-4 in single precision (`tests/test_quality.py`).

    **Source:** Jindal et al. 2021, Eq. 2 to 23.

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from camojab import Display, distortion, Spectrum, Viewing
    >>> noise = np.random.default_rng(0).uniform(size=(512, 512))
    >>> display = Display(ppd=60, refresh_rate=jnp.array([30.0, 60.0]), luminance=100)
    >>> parts = distortion(Spectrum.from_texture(noise), display, Viewing(10.0))
    >>> print(np.asarray(parts.spatial).round(1), np.asarray(parts.temporal).round(1))
    [7.7 6.2] [4.1 0.7]
    """
    _check_precision(spectrum)
    condition = _condition(
        display, viewing, shading, parameters, formulation, components
    )
    return (fidelity or Exact()).distortion(spectrum, condition, formulation)


def error_estimate(
    spectrum: Spectrum,
    display: Display,
    viewing: Viewing,
    shading: Shading | None = None,
    parameters: Parameters | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
    components: Components | None = None,
    fidelity: AbstractFidelity,
) -> float:
    """How far a fidelity is from `Exact()` under the worst of some conditions. [JND].

    The rung's own estimate, which needs no exact evaluation.

    **Arguments:** as `quality`.

    **Accuracy:** at least half of the largest error (`tests/test_fidelity.py`).

    **Raises:** as `distortion`; `ValueError` under a JAX transformation.
    """
    _check_precision(spectrum)
    condition = _condition(
        display, viewing, shading, parameters, formulation, components
    )
    return fidelity.error_jnd(spectrum, condition, formulation)


def choose_fidelity(
    spectrum: Spectrum,
    display: Display,
    viewing: Viewing,
    shading: Shading | None = None,
    parameters: Parameters | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
    components: Components | None = None,
    fidelity: Auto,
) -> AbstractFidelity:
    """The rung that `fidelity` takes for these conditions, to pass on as it is.

    **Arguments:** as `quality`.

    **Raises:** as `distortion`; `ValueError` under a JAX transformation.
    """
    _check_precision(spectrum)
    condition = _condition(
        display, viewing, shading, parameters, formulation, components
    )
    return fidelity.choose(spectrum, condition, formulation)


def _condition(
    display: Display,
    viewing: Viewing,
    shading: Shading | None,
    parameters: Parameters | None,
    formulation: Formulation,
    components: Components | None,
) -> Condition:
    return Condition(
        display,
        viewing,
        shading or Shading(),
        components or Components(),
        parameters or Parameters.published(formulation),
    )


def _check_precision(spectrum: Spectrum) -> None:
    if spectrum.amplitude.dtype not in (jnp.float32, jnp.float64):
        raise ValueError(
            "`spectrum` must be in float32 or float64, since less costs more than 0.1 "
            f"JND, got {spectrum.amplitude.dtype}."
        )


class PooledTexture(eqx.Module):
    """A texture at one mip level and shading rate, its energies already pooled.

    Made by `pool`.
    """

    energies: ReleasedPool | PaperPool | NodePool
    parameters: Parameters
    formulation: Formulation = eqx.field(static=True)


def pool(
    spectrum: Spectrum,
    shading: Shading | None = None,
    parameters: Parameters | None = None,
    *,
    formulation: Formulation = Formulation.RELEASED,
    fidelity: Exact | Pooled | None = None,
) -> PooledTexture:
    """Pool the energies of a texture at one mip level and rate, for `pooled_quality`.

    **Arguments:** as `distortion`; the fields of `shading` and `parameters` are scalars
    here, and `vmap` serves several. With `Exact()`, the default, nothing is lost, and
    a further display or velocity costs about a tenth of starting from the spectrum.

    **Raises:** `ValueError` if the spectrum is in a precision below single.

    **Example:**

    >>> import jax.numpy as jnp
    >>> import numpy as np
    >>> from camojab import Display, pool, Pooled, pooled_quality, Spectrum, Viewing
    >>> noise = np.random.default_rng(0).uniform(size=(512, 512))
    >>> pooled = pool(Spectrum.from_texture(noise), fidelity=Pooled(2000))
    >>> display = Display(ppd=60, refresh_rate=60, luminance=100)
    >>> moving = Viewing(jnp.array([0.0, 10.0]))  # [deg/s]
    >>> print(np.asarray(pooled_quality(pooled, display, moving)).round(1))
    [ -5.7 -24.9]
    """
    _check_precision(spectrum)
    return _pool(
        spectrum,
        shading or Shading(),
        parameters or Parameters.published(formulation),
        formulation,
        fidelity or Exact(),
    )


@eqx.filter_jit
def _pool(
    spectrum: Spectrum,
    shading: Shading,
    parameters: Parameters,
    formulation: Formulation,
    fidelity: Exact | Pooled,
) -> PooledTexture:
    amplitude = spectrum.amplitude
    same = lambda tree: jax.tree.map(lambda x: x.astype(amplitude.dtype), tree)
    shading, parameters = same(shading), same(parameters)
    energies = CHAIN[formulation].pool(amplitude, shading, Components(), parameters)
    if isinstance(fidelity, Pooled):
        energies = pool_on_nodes(energies, formulation, fidelity)
    return PooledTexture(energies, parameters, formulation)


@eqx.filter_jit
def pooled_quality(
    pooled: PooledTexture, display: Display, viewing: Viewing
) -> Float[Array, "..."]:
    """`quality` of a pooled texture. [JND].

    **Arguments:** `display` and `viewing` as `distortion`, of shapes that broadcast.

    **Returns:** quality in the broadcast shape. [JND].
    """
    energies, p = pooled.energies, pooled.parameters
    condition = Condition(display, viewing, Shading(), Components(), p)
    if isinstance(energies, NodePool):
        of = batch(condition, p.beta.dtype)
        spatial, temporal, _ = on_pools(
            energies, of.conditions, jnp.asarray(of.setting), pooled.formulation
        )
        return (p.ws * spatial + p.wt * temporal).reshape(of.shape)
    chain = CHAIN[pooled.formulation]
    shape, conditions = flattened(condition, p.beta.dtype)

    @jax.checkpoint
    def one(c: Condition) -> Array:
        spatial, temporal, _ = chain.evaluate(energies, c)
        return p.ws * spatial + p.wt * temporal

    return jax.lax.map(one, conditions).reshape(shape)
