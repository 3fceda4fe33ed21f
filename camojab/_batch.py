"""Conditions of any shapes in the order in which they are evaluated.

Pooling depends on the texture, the mip level, the rate and the exponent alone, so the
conditions that share these, a setting, are evaluated from one pool.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.core
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ._condition import common_shape, Condition


# Conditions that an error is estimated from.
_SAMPLE = 2048


class Batch(NamedTuple):
    """Conditions as flat arrays, and which of them share a setting.

    - `shape`: that the fields broadcast to; `rows` is the number of its elements.
    - `conditions`: each field one number, or one a row.
    - `first`: a row of each setting.
    - `setting`: of each row, as an index into `first`.
    """

    shape: tuple[int, ...]
    conditions: Condition
    first: Int[np.ndarray, " settings"]
    setting: Int[np.ndarray, " rows"]


def batch(condition: Condition, dtype) -> Batch:
    """The settings are told apart by value, or, where they are traced, by shape.

    **Raises:** `ValueError` if the shapes do not broadcast.
    """
    shape = common_shape(condition)

    def flat(x: Array) -> Array:
        x = x.astype(bool if x.dtype == bool else dtype)
        if x.size == 1 and math.prod(shape) != 0:
            return x.reshape(())
        return jnp.broadcast_to(x, shape).ravel()

    first, setting = _settings([np.shape(x) for x in _pooled_by(condition)], shape)
    if not any(isinstance(x, jax.core.Tracer) for x in _pooled_by(condition)):
        first, setting = _distinct(_pooled_by(condition), shape, first, setting)
    return Batch(shape, jax.tree.map(flat, condition), first, setting)


def setting_shape(condition: Condition) -> tuple[int, ...]:
    """The shape that the fields that pooling depends on broadcast to."""
    return np.broadcast_shapes(*(x.shape for x in _pooled_by(condition)))


def _pooled_by(c: Condition) -> list[Array]:
    fields = [c.shading.rate_x, c.shading.rate_y, c.shading.mip_level]
    return [*fields, c.parameters.beta, c.parameters.mipmap_width, c.components.vrs]


def _settings(
    shapes: Sequence[tuple[int, ...]], shape: tuple[int, ...]
) -> tuple[Int[np.ndarray, " settings"], Int[np.ndarray, " rows"]]:
    own = np.broadcast_shapes(*shapes)
    own = (1,) * (len(shape) - len(own)) + own
    rows = np.arange(math.prod(shape)).reshape(shape)
    first = rows[tuple(slice(0, 1) if n == 1 else slice(None) for n in own)].ravel()
    setting = np.broadcast_to(np.arange(math.prod(own)).reshape(own), shape)
    return first, setting.ravel()


def _distinct(
    fields: Sequence[Array],
    shape: tuple[int, ...],
    first: Int[np.ndarray, " settings"],
    setting: Int[np.ndarray, " rows"],
) -> tuple[Int[np.ndarray, " distinct"], Int[np.ndarray, " rows"]]:
    """Settings whose numbers are all the same become one."""
    code = np.zeros(len(first), int)
    for field in fields:
        if field.size > 1:
            values = np.broadcast_to(np.asarray(field), shape).ravel()[first]
            kinds, kind = np.unique(values, return_inverse=True)
            code = np.unique(code * len(kinds) + kind, return_inverse=True)[1]
    _, kept, distinct = np.unique(code, return_index=True, return_inverse=True)
    return first[kept], distinct[setting]


def sampled(of: Batch) -> Batch:
    """Some two thousand of many conditions, with the extremes of every field.

    **Raises:** `ValueError` under a JAX transformation.
    """
    if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(of.conditions)):
        raise ValueError(
            "the error of a fidelity must be asked for outside JAX transformations."
        )
    rows = len(of.setting)
    if rows <= _SAMPLE:
        return of
    # An even stride would fall in step with the axes of a grid.
    chosen = [np.random.default_rng(0).choice(rows, _SAMPLE, replace=False)]
    for x in jax.tree.leaves(of.conditions):
        if x.ndim:
            chosen.append(np.array([np.argmin(x), np.argmax(x)]))
    picked = np.unique(np.concatenate(chosen))
    conditions = jax.tree.map(lambda x: x[picked] if x.ndim else x, of.conditions)
    _, first, setting = np.unique(
        of.setting[picked], return_index=True, return_inverse=True
    )
    return Batch(picked.shape, conditions, first, setting)
