"""How closely the model is evaluated: what every rung between exact and fast shares."""

import abc

import equinox as eqx
from jaxtyping import Array, Float

from ._condition import Condition, Terms
from ._csf import broadcast
from ._parameters import Formulation
from ._spectrum import Spectrum


# What the worst of sampled conditions may be surpassed by.
SAFETY = 1.5


class Distortion(eqx.Module):
    """Visual energy lost and added, in the shape of the conditions. [1].

    - `spatial`: energy that mipmapping, coarse shading and eye blur took from the
      texture; negative where aliases add more than blur removes.
    - `temporal`: energy of the replica that the refresh rate lets through, >= 0.
    - `evaluated`: the terms that could matter, each a boolean a condition.
    - `fidelity`: how closely it was evaluated, in words.

    **Source:** Jindal et al. 2021, Eq. 21 and 23.
    """

    spatial: Float[Array, "..."]
    temporal: Float[Array, "..."]
    evaluated: Terms
    fidelity: str = eqx.field(static=True)


class AbstractFidelity(abc.ABC):
    """A way to evaluate the model: one of the rungs between exact and fast.

    Instances can be compared, and are static under JAX transformations unless they hold
    arrays.
    """

    @abc.abstractmethod
    def distortion(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Distortion:
        """Spatial and temporal distortion of a texture under conditions."""

    @abc.abstractmethod
    def error_jnd(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> float:
        """Estimate of the largest error of `quality` among these conditions. [JND]."""

    def quality(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Float[Array, "..."]:
        """Quality in the shape of the conditions, 0 where nothing is lost. [JND]."""
        parts = self.distortion(spectrum, condition, formulation)
        weights = condition.parameters.ws, condition.parameters.wt
        ws, wt, spatial, temporal = broadcast(*weights, parts.spatial, parts.temporal)
        return ws * spatial + wt * temporal
