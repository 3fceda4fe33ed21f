"""The cheapest rung that is accurate enough for what is asked of it."""

import math
from dataclasses import dataclass

from jaxtyping import Array, Float

from ._batch import batch
from ._condition import Condition
from ._exact import Exact
from ._fidelity import AbstractFidelity, Distortion
from ._parameters import Formulation
from ._pooled import Pooled
from ._spectrum import Spectrum


# Conditions a setting that repay the time of pooling and of its error estimate.
_REPAYS = 32


@dataclass(frozen=True)
class Auto(AbstractFidelity):
    """The first of some rungs whose own error estimate meets a tolerance.

    The choice is made for the texture and all the conditions of a call together, and
    `Distortion.fidelity` names it. Where a setting (mip level, rate, exponent) meets
    fewer than 32 conditions no rung is cheaper than `Exact`, which is taken at once.

    **Arguments:**

    - `tolerance_jnd`: largest error of a quality. [JND], >= 0.
    - `rungs`: to choose from, the cheapest first; `Exact` follows the last.

    **Raises:** `ValueError` for a tolerance out of range; when used, under a JAX
    transformation of the conditions: call `choose_fidelity` before it and pass what it
    returns.
    """

    tolerance_jnd: float = 0.05
    rungs: tuple[AbstractFidelity, ...] = tuple(map(Pooled, (1000, 2000, 5000, 10_000)))

    def __post_init__(self):
        if not 0 <= self.tolerance_jnd < math.inf:
            raise ValueError(
                "`tolerance_jnd` must be finite and >= 0 JND, got "
                f"{self.tolerance_jnd!r}."
            )

    def choose(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> AbstractFidelity:
        """The rung that a call with these arguments is evaluated on."""
        of = batch(condition, spectrum.amplitude.dtype)
        if len(of.setting) < _REPAYS * len(of.first):
            return Exact()
        for rung in self.rungs:
            if rung.error_jnd(spectrum, condition, formulation) <= self.tolerance_jnd:
                return rung
        return Exact()

    def distortion(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Distortion:
        """See `AbstractFidelity.distortion`."""
        rung = self.choose(spectrum, condition, formulation)
        return rung.distortion(spectrum, condition, formulation)

    def quality(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Float[Array, "..."]:
        """See `AbstractFidelity.quality`."""
        rung = self.choose(spectrum, condition, formulation)
        return rung.quality(spectrum, condition, formulation)

    def error_jnd(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> float:
        """The estimate of the rung that is chosen. [JND]."""
        rung = self.choose(spectrum, condition, formulation)
        return rung.error_jnd(spectrum, condition, formulation)
