"""The model to the bin: every condition on all 512 x 512 frequencies."""

import math
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ._batch import setting_shape
from ._chains import CHAIN
from ._condition import common_shape, Condition, Terms
from ._fidelity import AbstractFidelity, Distortion
from ._parameters import Formulation
from ._spectrum import Spectrum


@dataclass(frozen=True)
class Exact(AbstractFidelity):
    """All 512 x 512 frequencies, as the formulation has them.

    Energies are pooled anew wherever the shape of the fields of `Shading`, `beta`,
    `mipmap_width` and `vrs` has another element, and conditions follow one after the
    other, so that memory does not grow with their number, forward or backward. One
    compilation serves all conditions of these shapes.
    """

    def distortion(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> Distortion:
        """See `AbstractFidelity.distortion`."""
        dtype = spectrum.amplitude.dtype
        shape, setting = common_shape(condition), setting_shape(condition)
        axes = _axes(setting, shape)
        ordered = tuple(shape[i] for i in axes)
        outer = sum(n != 1 for n in setting)

        def by_setting(x: Array) -> Array:
            x = x.astype(bool if x.dtype == bool else dtype)
            rows = math.prod(ordered[:outer]), math.prod(ordered[outer:])
            return jnp.broadcast_to(x, shape).transpose(axes).reshape(rows)

        conditions = jax.tree.map(by_setting, condition)
        parts = _evaluated(spectrum, conditions, formulation)
        back = tuple(axes.index(i) for i in range(len(axes)))
        parts = jax.tree.map(lambda x: x.reshape(ordered).transpose(back), parts)
        return Distortion(*parts, fidelity=str(self))

    def error_jnd(
        self, spectrum: Spectrum, condition: Condition, formulation: Formulation
    ) -> float:
        """None but rounding: 0. [JND]."""
        del spectrum, condition, formulation
        return 0.0


def _axes(setting: tuple[int, ...], shape: tuple[int, ...]) -> tuple[int, ...]:
    """The axes along which the setting varies, before the others."""
    padded = (1,) * (len(shape) - len(setting)) + setting
    return tuple(sorted(range(len(shape)), key=lambda i: padded[i] == 1))


@eqx.filter_jit
def _evaluated(
    spectrum: Spectrum, conditions: Condition, formulation: Formulation
) -> tuple[Array, Array, Terms]:
    """Of conditions in an array [settings, conditions of each]."""
    chain = CHAIN[formulation]

    # Checkpointed, or the backward pass would keep every condition's spectra.
    @jax.checkpoint
    def of_setting(c: Condition) -> tuple[Array, Array, Terms]:
        one = jax.tree.map(lambda x: x[0], c)
        parts = one.shading, one.components, one.parameters
        energies = chain.pool(spectrum.amplitude, *parts)
        return jax.lax.map(jax.checkpoint(lambda c: chain.evaluate(energies, c)), c)

    rows = conditions.display.ppd.shape
    if math.prod(rows) == 0:
        nothing, none = jnp.zeros(rows, spectrum.amplitude.dtype), jnp.zeros(rows, bool)
        return nothing, nothing, Terms(none, none, none, jnp.zeros(rows, int))
    return jax.lax.map(of_setting, conditions)
