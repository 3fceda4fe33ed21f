from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from camojab import (
    Display,
    Exact,
    Formulation,
    Parameters,
    Pooled,
    Spectrum,
    Viewing,
)
from camojab._errors import check

from .._frame import Frame
from .._rates import RATES
from ..tables import Domain, Scene
from ..tables._scene import PUBLISHED_LEVELS
from ..tables._tables import index_entries
from ._base import AbstractQualityOracle
from ._checks import checked_refresh_rate, known_texture, positive
from ._groups import in_blocks
from ._settings import AbstractSettings, settings


# Below it the sensitivity to contrast is not known. [cd/m^2].
_DARKEST = 1e-3


class CamojabOracle(AbstractQualityOracle, strict=True):
    """The model itself: CaMoJAB of every tile, for motion along x and along y.

    Motion along y is motion along x over the transposed texture, with the sides of the
    coarse pixel swapped (Eq. 28); the quality of a tile is the mean of both (Eq. 29).
    0 is a tile that lost nothing, not one at some rate.

    The mip level of a tile counts as the nearest that is modelled of its texture, the
    finer of two, and a luminance below 0.001 cd/m^2 as that; `count_outside` tells of
    how many tiles.

    Tiles are judged in blocks that share a pair of texture and mip level, so memory
    does not grow with their number but for the result. With `Pooled` every setting is
    pooled once, here, which takes about a quarter of a second and 0.3 MB a pair (5000
    cells, single precision); a frame of 8160 tiles then takes about 0.04 s on two cores
    and 1 MB besides. With `Exact` it keeps 1 MB a texture, pools anew for every block
    and takes 0.03 s a tile, ten times that in the paper's formulation. What frames or
    refresh rates are mapped over takes as much for each.

    **Arguments:**

    - `textures`: spectra by name, in the order of the frames' texture indices, of one
      floating dtype, which is that of the qualities.
    - `mip_levels`: at which every texture is modelled, rising. [octaves], >= 0. The
      twelve of the published tables, if both this and `pairs` are left out.
    - `pairs`: instead of it, the pairs of texture index and mip level that occur, such
      as `alsarr.tables.Scene.of_frames(...).pairs`.
    - `ppd` [px/deg] and `persistence` [1] of the display.
    - `parameters`: of the model; the published ones of `formulation` if left out.
    - `fidelity`: `Pooled()` if left out, or `Exact()`, the reference.

    **Raises:** `ValueError` for no textures, textures of several dtypes, levels or
    pairs that do not rise or are out of range, both of them, and numbers out of range.

    **Accuracy:** with `Exact()` that of `camojab.quality`; with `Pooled()` within
    0.0005 JND of it on the textures of Jindal et al. 2021 (240 tiles, levels 0, 2 and
    5, at rest to 60 deg/s). `camojab.error_estimate` tells of others.

    **Source:** Jindal et al. 2021, ACM Trans. Graph. 40(6), Eq. 28 and 29.
    """

    settings: AbstractSettings
    entry: Int[Array, "textures levels"]
    occurs: Bool[Array, "textures levels"]
    mip_levels: Float[Array, " levels"]
    ppd: Float[Array, ""]
    persistence: Float[Array, ""]
    parameters: Parameters
    formulation: Formulation = eqx.field(static=True)
    fidelity: Exact | Pooled = eqx.field(static=True)

    unit: ClassVar[str] = "JND"

    def __init__(
        self,
        textures: Mapping[str, Spectrum],
        *,
        ppd: ArrayLike,
        persistence: ArrayLike = 1.0,
        mip_levels: Sequence[float | int] | None = None,
        pairs: Sequence[tuple[int, float]] | None = None,
        parameters: Parameters | None = None,
        formulation: Formulation = Formulation.RELEASED,
        fidelity: Exact | Pooled | None = None,
    ):
        dtype = _one_dtype(textures)
        scene = _scene(len(textures), mip_levels, pairs)
        owners = [(texture, (level,)) for texture, level in scene.pairs]
        entry, occurs = index_entries(len(textures), scene.mip_levels, owners)
        same = lambda tree: jax.tree.map(lambda x: x.astype(dtype), tree)
        self.formulation = formulation
        self.fidelity = fidelity or Pooled()
        self.parameters = same(parameters or Parameters.published(formulation))
        self.ppd = same(positive("ppd", ppd, "px/deg"))
        share = lambda p: (p > 0) & (p <= 1)
        self.persistence = same(check("persistence", persistence, share, "in (0, 1]"))
        self.entry, self.occurs = jnp.asarray(entry), jnp.asarray(occurs)
        self.mip_levels = jnp.asarray(scene.mip_levels, dtype)
        self.settings = settings(
            list(textures.values()),
            scene.pairs,
            self.parameters,
            formulation,
            self.fidelity,
        )

    def quality(self, frame: Frame, refresh_rate: ArrayLike) -> Float[Array, "tiles 7"]:
        """See `AbstractQualityOracle.quality`. [JND], in the dtype of the spectra.

        **Raises:** also for a texture index that is not modelled.
        """
        rate = checked_refresh_rate(refresh_rate).astype(self.ppd.dtype)
        texture = self._texture(frame)
        entry = self.entry[texture, self._level(frame)]
        velocity = jnp.stack([frame.velocity_x.ravel(), frame.velocity_y.ravel()])
        return _quality(
            self, entry, velocity.astype(self.ppd.dtype), self._luminance(frame), rate
        )

    def count_outside(self, frame: Frame, refresh_rate: ArrayLike) -> Int[Array, ""]:
        """How many tiles are judged at another mip level or luminance than their own.

        A level that rounds to the modelled one is its own.
        """
        used = self.occurs[self._texture(frame), self._level(frame)]
        ends = self.mip_levels
        level = frame.mip_level.ravel().astype(ends.dtype)
        rate = checked_refresh_rate(refresh_rate)
        outside = (
            ~used
            # What lies half way is nearest to the finer level.
            | (level <= ends[0] - 0.5)
            | (level > ends[-1] + 0.5)
            | (frame.luminance.ravel() < _DARKEST)
        )
        # The refresh rate may be any; used, or its check would be dropped.
        return jnp.sum(outside & (rate > 0))

    def _texture(self, frame: Frame) -> Int[Array, " tiles"]:
        holds = lambda t: (t < self.entry.shape[0]) & (self.entry[t, 0] >= 0)
        return known_texture(frame, holds, "a texture that is modelled")

    def _level(self, frame: Frame) -> Int[Array, " tiles"]:
        """Index of the nearest level, the finer of two."""
        level = frame.mip_level.ravel().astype(self.mip_levels.dtype)
        distance = jnp.abs(self.mip_levels[:, None] - level[None])
        return jnp.argmin(distance, axis=0)

    def _luminance(self, frame: Frame) -> Float[Array, " tiles"]:
        return jnp.maximum(frame.luminance.ravel(), _DARKEST).astype(self.ppd.dtype)


@eqx.filter_jit
def _quality(
    oracle: CamojabOracle,
    entry: Int[Array, " tiles"],
    velocity: Float[Array, "2 tiles"],
    luminance: Float[Array, " tiles"],
    refresh_rate: Float[Array, ""],
) -> Float[Array, "tiles 7"]:
    """Block by block, of which those that no tile needs are left out."""
    modelled = oracle.settings
    display = Display(
        ppd=oracle.ppd,
        refresh_rate=refresh_rate,
        luminance=luminance,
        persistence=oracle.persistence,
    )
    viewing = Viewing(velocity)
    blocks = in_blocks(entry, modelled.pairs, modelled.block)

    def of_block(
        block: tuple[Int[Array, ""], Int[Array, " size"], Bool[Array, ""]],
    ) -> Float[Array, "size 7"]:
        pair, tile, used = block
        own = lambda tree: jax.tree.map(lambda x: x[..., tile] if x.ndim else x, tree)

        def mean() -> Float[Array, "size 7"]:
            shown = own(display), own(viewing)
            both = modelled.quality(pair, *shown, oracle.parameters, oracle.formulation)
            return jnp.mean(both, axis=0).T

        none = lambda: jnp.zeros((tile.size, len(RATES)), luminance.dtype)
        return jax.lax.cond(used, mean, none)

    # Checkpointed, or a gradient would keep what was computed of every block.
    found = jax.lax.map(jax.checkpoint(of_block), blocks[:3])
    return found.reshape(-1, len(RATES))[blocks.place]


def _one_dtype(textures: Mapping[str, Spectrum]) -> jnp.dtype:
    dtypes = {str(spectrum.amplitude.dtype) for spectrum in textures.values()}
    if len(dtypes) != 1:
        raise ValueError(
            "`textures` must be one or more spectra of one dtype, got "
            f"{' and '.join(sorted(dtypes)) or 'none'}."
        )
    return jnp.dtype(dtypes.pop())


def _scene(
    textures: int,
    mip_levels: Sequence[float | int] | None,
    pairs: Sequence[tuple[int, float]] | None,
) -> Scene:
    if pairs is None:
        levels = PUBLISHED_LEVELS if mip_levels is None else mip_levels
        return Scene.every(textures, levels)
    if mip_levels is not None:
        raise ValueError(
            f"`mip_levels` must be left out where `pairs` are given, got {mip_levels}."
        )
    every = tuple((int(texture), float(level)) for texture, level in pairs)
    return Scene(textures, every, Domain())
