"""What a scene needs of the tables: which textures, at which levels, shown how."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._frame import Frame
from ._domain import Domain


# Darker tiles count as this dark: below it the sensitivity to contrast is not known.
_DARKEST = 1e-3

PUBLISHED_LEVELS = tuple(range(12))
"""Mip levels that the published tables have of every texture."""


@dataclass(frozen=True)
class Scene:
    """The (texture, mip level) pairs that occur, and the conditions they occur in.

    - `num_textures`: that texture indices count.
    - `pairs`: of texture index and mip level [octaves], rising.
    - `domain`: of everything that occurs.

    **Raises:** `ValueError` for no pairs, a texture index out of range, a level below 0
    or pairs that do not rise.
    """

    num_textures: int
    pairs: tuple[tuple[int, float], ...]
    domain: Domain

    def __post_init__(self):
        if not self.pairs:
            raise ValueError("`pairs` must be one or more, got none.")
        for texture, level in self.pairs:
            if not 0 <= texture < self.num_textures:
                raise ValueError(
                    f"`pairs` must have texture indices from 0 to "
                    f"{self.num_textures - 1}, got {texture}."
                )
            if not (level >= 0 and np.isfinite(level)):
                raise ValueError(
                    f"`pairs` must have finite mip levels >= 0, got {level:g}."
                )
        if sorted(set(self.pairs)) != list(self.pairs):
            raise ValueError("`pairs` must rise, each once.")

    @classmethod
    def every(
        cls,
        num_textures: int,
        mip_levels: Sequence[float | int] = PUBLISHED_LEVELS,
        domain: Domain | None = None,
    ) -> "Scene":
        """All textures at all levels, where nothing is known of the frames.

        **Raises:** `ValueError` for no texture or levels that do not rise.
        """
        if num_textures < 1:
            raise ValueError(f"`num_textures` must be >= 1, got {num_textures}.")
        levels = [float(level) for level in mip_levels]
        if not levels or sorted(set(levels)) != levels:
            raise ValueError(
                f"`mip_levels` must be one or more, rising, got {tuple(mip_levels)}."
            )
        pairs = ((t, level) for t in range(num_textures) for level in levels)
        return cls(num_textures, tuple(pairs), domain or Domain())

    @classmethod
    def of_frames(
        cls,
        frames: Sequence[Frame],
        *,
        num_textures: int,
        refresh_rate: tuple[float, float],
    ) -> "Scene":
        """What occurs in some frames, shown at any of a range of refresh rates.

        Mip levels are those that tables round to: the nearest whole one, the finer of
        two. Tiles darker than 0.001 cd/m^2 count as that.

        **Arguments:**

        - `num_textures`: that the frames' texture indices count.
        - `refresh_rate`: lowest and highest. [Hz].

        **Raises:** `ValueError` for no frame, and as `Scene` and `Domain`.

        **Example:**

        >>> from alsarr import procedural_frame
        >>> from alsarr.tables import Scene
        >>> frame = procedural_frame(3, rows=9, columns=16, seed=1)
        >>> rates = (30.0, 120.0)  # [Hz]
        >>> scene = Scene.of_frames([frame], num_textures=3, refresh_rate=rates)
        >>> len(scene.pairs)  # of 3 textures at 12 levels
        10
        """
        if not frames:
            raise ValueError("`frames` must have at least one frame, got none.")
        pairs = set()
        for frame in frames:
            texture = np.asarray(frame.texture).ravel()
            level = nearest_level(np.asarray(frame.mip_level).ravel())
            pairs |= set(zip(texture.tolist(), level.tolist(), strict=True))
        velocity = _ends(frames, "velocity_x", "velocity_y")
        low, high = np.maximum(_ends(frames, "luminance"), _DARKEST)
        domain = Domain(
            velocity=velocity,
            refresh_rate=refresh_rate,
            log10_luminance=(float(np.log10(low)), float(np.log10(high))),
        )
        return cls(num_textures, tuple(sorted(pairs)), domain)

    @property
    def mip_levels(self) -> tuple[float, ...]:
        """Every level that occurs, rising. [octaves]."""
        return tuple(sorted({level for _, level in self.pairs}))


def nearest_level(mip_level: np.ndarray) -> np.ndarray:
    """The nearest whole level, the finer of two. [octaves]."""
    return np.maximum(np.ceil(mip_level - 0.5), 0.0).astype(float)


def left_out(scene: Scene, names: Sequence[str]) -> str:
    """One line that says what of the published levels a scene has no need of."""
    every = {(t, float(m)) for t in range(len(names)) for m in PUBLISHED_LEVELS}
    absent = sorted(every - set(scene.pairs))
    levels = {t: [int(m) for s, m in absent if s == t] for t, _ in absent}
    parts = [f"{names[t]} {_runs(of)}" for t, of in levels.items()]
    kept = f"{len(scene.pairs)} of {len(every)} pairs of texture and mip level"
    return f"{kept}; left out: {', '.join(parts) or 'none'}"


def _ends(frames: Sequence[Frame], *fields: str) -> tuple[float, float]:
    values = [np.asarray(getattr(frame, field)) for frame in frames for field in fields]
    return float(min(v.min() for v in values)), float(max(v.max() for v in values))


def _runs(levels: list[int]) -> str:
    """Whole numbers with what follows one another drawn together."""
    starts = [m for m in levels if m - 1 not in levels]
    stops = [m for m in levels if m + 1 not in levels]
    ends = zip(starts, stops, strict=True)
    return "+".join(str(a) if a == b else f"{a}-{b}" for a, b in ends)
