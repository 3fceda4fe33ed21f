"""What a network learns from: inputs and the metric of rendered viewpoints."""

import json
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32

from camojab._errors import shown
from camojab._files import replacing

from .._rates import RATES, TILE
from ._file import read_archive
from ._model import DEFAULT_CHANNELS, DEFAULT_OUTPUTS


SCHEMA = "alsarr-targets/1"

_MOST_BYTES = 2**31
# As many views are computed between two writings of their targets.
_BETWEEN = 16
# What of a metric is as good as infinite.
_MOST_MEDIANS = 10_000.0

Metric = Callable[..., Float[Array, "rows columns"]]
"""`alsarr.metrics.METRICS` has them: (reference, test, *, ppd) -> one value a tile."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Viewpoints of one size, compact enough to hold hundreds in memory.

    - `inputs`: each channel of every view, to whole tiles by repeating the last row and
      column. Normals and the reflect product in half precision, the rest as bytes that
      count to 255.
    - `targets`: the metric of every tile at each of `outputs`. [unit of the metric]
    - `seen`: tiles of which at least half of the pixels were seen in the previous
      picture.
    - `names`: of the views.
    - `scenes`: the scene of each view.
    - `outputs`: names of rates.
    - `metric`: its name.
    - `ppd`: at which it was seen. [px/deg]
    """

    inputs: dict[str, np.ndarray]
    targets: Float32[np.ndarray, "views outputs rows columns"]
    seen: Bool[np.ndarray, "views rows columns"]
    names: tuple[str, ...]
    scenes: tuple[str, ...]
    outputs: tuple[str, ...]
    metric: str
    ppd: float

    def __len__(self) -> int:
        return len(self.names)

    def mean(self) -> float:
        """Mean of the targets, about which a transform is made.

        It leaves out what is as good as infinite: values of more than 10 000 times the
        median of those above 0. Where the reference is black, an error over luminance
        (`alsarr.metrics.weber`) is a million times its median and more, so that a
        single tile would decide; transforms take it to 1 all the same. Without any it
        is the plain mean: no other tile of four rendered scenes came to 800 medians.

        **Returns:** [unit of the metric], 0 where nothing is left.
        """
        values = counted(self.targets, largest_counted(self.targets))
        return float(values.mean()) if values.size else 0.0

    def take(self, views: Sequence[int]) -> "Samples":
        """Some of the views."""
        chosen = np.asarray(views, int)
        parts: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        return Samples(
            **parts
            | {
                "inputs": {k: v[chosen] for k, v in self.inputs.items()},
                "targets": self.targets[chosen],
                "seen": self.seen[chosen],
                "names": tuple(self.names[i] for i in chosen),
                "scenes": tuple(self.scenes[i] for i in chosen),
            }
        )

    def of_scene(self, scene: str) -> "Samples":
        """The views of one scene.

        **Raises:** `ValueError` for a scene that has none.
        """
        views = [i for i, name in enumerate(self.scenes) if name == scene]
        if not views:
            there = ", ".join(sorted(set(self.scenes)))
            raise ValueError(f"`scene` must be one of {there}, got {scene}.")
        return self.take(views)

    def split(self, held_out: int, *, seed: int) -> tuple["Samples", "Samples"]:
        """Views to learn from, and `held_out` others of each scene.

        **Raises:** `ValueError` if a scene has no more views than that.
        """
        held = []
        random = np.random.default_rng(seed)
        for scene in sorted(set(self.scenes)):
            views = [i for i, name in enumerate(self.scenes) if name == scene]
            if not 0 < held_out < len(views):
                raise ValueError(
                    f"`held_out` must be > 0 and less than the {len(views)} views of "
                    f"{scene}, got {held_out}."
                )
            held += random.choice(views, held_out, replace=False).tolist()
        kept = sorted(set(range(len(self))) - set(held))
        return self.take(kept), self.take(sorted(held))

    def picture(
        self,
        channels: tuple[str, ...],
        view: int,
        rows: slice = slice(None),
        columns: slice = slice(None),
    ) -> Float32[np.ndarray, "channels height width"]:
        """Inputs of one view, or of some of its pixels, as a network takes them.

        **Raises:** `ValueError` for a channel that was not loaded.
        """
        missing = [name for name in channels if name not in self.inputs]
        if missing:
            raise ValueError(
                f"`samples` must have the channel {missing[0]}, got "
                f"{', '.join(self.inputs)}."
            )
        return np.stack([_wide(self.inputs[c][view, rows, columns]) for c in channels])


def load_samples(
    paths: Sequence[str | Path],
    *,
    metric: str,
    ppd: float,
    channels: tuple[str, ...] = DEFAULT_CHANNELS,
    outputs: tuple[str, ...] = DEFAULT_OUTPUTS,
    function: Metric | None = None,
    keep: bool = True,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Samples:
    """Views that `alsarr.capture` wrote, with the metric of every tile.

    The metric takes most of the time, so it is kept in a file beside the views whose
    name has the metric, ppd and rates; a view that changed is computed anew. 500 views
    of 640x368 with four channels need 0.7 GB of memory.

    **Arguments:**

    - `paths`: of views of one size, from any number of scenes and folders.
    - `metric`: of `alsarr.metrics.METRICS`, or the name under which what `function`
        finds is kept: give another name for other weights.
    - `ppd`: for which the metric is computed. [px/deg], > 0
    - `channels`: inputs, of `alsarr.capture.CHANNELS`. "seen" is always loaded.
    - `outputs`: names of rates.
    - `function`: a metric that is not in `METRICS`, such as `lpips_metric(weights)`. It
        is called as it is; most of one's own are faster under `jax.jit`.
    - `keep`: whether the metric is kept beside the views, and read from there.
    - `progress`: called with the number of views done and of all.

    **Raises:** `ValueError` without paths, for views of different sizes, unknown names,
    or a metric that is not a number; `OSError` for files that cannot be read or
    written.
    """
    if not paths:
        raise ValueError("`paths` must name at least one view.")
    if not ppd > 0:
        raise ValueError(f"`ppd` must be > 0 px/deg, got {shown(ppd)}.")
    wrong = [rate for rate in outputs if rate not in RATES.names[:-1]]
    if wrong:
        raise ValueError(f"`outputs` must be coarse rates, got {wrong[0]}.")
    measure = _measured(metric, ppd, outputs, function)
    names = tuple(dict.fromkeys((*channels, "seen")))
    files = [Path(path) for path in paths]
    targets = _Targets(metric, ppd, outputs, keep)
    gathered = _Gathered(len(files), names, outputs)
    try:
        for i, file in enumerate(files):
            gathered.add(i, file, targets, measure)
            progress(i + 1, len(files))
    finally:
        # What was computed until an interruption is not lost.
        targets.write()
    return gathered.samples(outputs, metric, ppd)


def largest_counted(targets: np.ndarray) -> float:
    """Of some targets, the largest that may count in their mean: see `Samples.mean`."""
    positive = targets[np.isfinite(targets) & (targets > 0)]
    return _MOST_MEDIANS * float(np.median(positive)) if positive.size else 0.0


def counted(targets: np.ndarray, largest: float) -> np.ndarray:
    """The targets, one after the other, that count in a mean."""
    return targets[np.isfinite(targets) & (targets <= largest)]


class _Gathered:
    """Arrays that are filled view by view, so that no view is held twice."""

    def __init__(self, count: int, channels: tuple[str, ...], outputs: tuple[str, ...]):
        self._count, self._outputs, self._channels = count, len(outputs), channels
        self._size: tuple[int, int] | None = None
        self._names: list[str] = []
        self._scenes: list[str] = []

    def add(self, i: int, file: Path, targets: "_Targets", measure: Callable) -> None:
        from ..capture import load_view

        view = load_view(file)
        if self._size is None:
            self._size = view.size
            self._make_room(*view.size)
        if view.size != self._size:
            raise ValueError(
                f"`paths` must be views of one size, got {self._size} px and "
                f"{view.size} px in {file}."
            )
        found = view.channels(self._channels)
        for name in self._channels:
            self._inputs[name][i] = _compact(name, _to_tiles(found[name]))
        self._seen[i] = _mostly_seen(found["seen"])
        self._targets[i] = targets.of(file, lambda: measure(view.images))
        self._names.append(str(file))
        self._scenes.append(view.scene)

    def _make_room(self, width: int, height: int) -> None:
        rows, columns = -(-height // TILE), -(-width // TILE)
        high = (self._count, rows * TILE, columns * TILE)
        self._inputs = {n: np.empty(high, _stored_type(n)) for n in self._channels}
        self._seen = np.empty((self._count, rows, columns), bool)
        shape = (self._count, self._outputs, rows, columns)
        self._targets = np.empty(shape, np.float32)

    def samples(self, outputs: tuple[str, ...], metric: str, ppd: float) -> Samples:
        return Samples(
            inputs=self._inputs,
            targets=self._targets,
            seen=self._seen,
            names=tuple(self._names),
            scenes=tuple(self._scenes),
            outputs=outputs,
            metric=metric,
            ppd=ppd,
        )


class _Targets:
    """A metric of the views of each folder, in one file a folder."""

    def __init__(self, metric: str, ppd: float, outputs: tuple[str, ...], keep: bool):
        self._task = {
            "schema": SCHEMA,
            "version": version("alsarr"),
            "metric": metric,
            "ppd": float(ppd),
            "outputs": list(outputs),
        }
        self._file_name = f"targets_{metric}_{float(ppd)!r}_{'_'.join(outputs)}.npz"
        self._keep = keep
        self._known: dict[Path, dict[str, np.ndarray]] = {}
        self._new: dict[Path, int] = {}

    def of(self, view: Path, compute: Callable[[], np.ndarray]) -> np.ndarray:
        if not self._keep:
            return compute()
        folder, key = view.parent, f"{view.name}:{_fingerprint(view)}"
        if folder not in self._known:
            self._known[folder] = self._read(folder)
        known = self._known[folder]
        if key not in known:
            known[key] = compute()
            self._new[folder] = self._new.get(folder, 0) + 1
            if self._new[folder] >= _BETWEEN:
                self._write(folder)
        return known[key]

    def write(self) -> None:
        for folder in list(self._new):
            self._write(folder)

    def _read(self, folder: Path) -> dict[str, np.ndarray]:
        path = folder / self._file_name
        try:
            header, arrays = read_archive(path, SCHEMA, _MOST_BYTES)
            keys = header.pop("views")
            # What does not belong to this, or is damaged, is computed again.
            if header != self._task:
                return {}
            return dict(zip(keys, arrays["targets"], strict=True))
        except (OSError, KeyError, TypeError, ValueError):
            return {}

    def _write(self, folder: Path) -> None:
        known = self._known[folder]
        header = json.dumps(self._task | {"views": list(known)})
        with replacing(folder / self._file_name) as temporary:
            with temporary.open("wb") as file:
                np.savez(
                    file,
                    allow_pickle=False,
                    header=np.array(header),
                    targets=np.stack(list(known.values())),
                )
        del self._new[folder]


def _fingerprint(view: Path) -> int:
    """Of what the archive says that it holds, without reading it."""
    with zipfile.ZipFile(view) as archive:
        parts = sorted((member.filename, member.CRC) for member in archive.infolist())
    return zlib.crc32(json.dumps(parts).encode())


def _measured(
    metric: str, ppd: float, outputs: tuple[str, ...], function: Metric | None
) -> Callable[[np.ndarray], np.ndarray]:
    """What finds the metric of seven pictures at each of the outputs."""
    if function is None:
        from ..metrics import METRICS

        if metric not in METRICS:
            raise ValueError(
                f"`metric` must be one of {', '.join(METRICS)}, got {metric}."
            )
        function = METRICS[metric]
    of: Metric = function

    def measure(images: np.ndarray) -> np.ndarray:
        light = jnp.asarray(images.astype(np.float32) / np.float32(255))
        tests = [light[RATES.names.index(rate)] for rate in outputs]
        # As one program FLIP takes several times as long.
        found = [of(light[-1], test, ppd=ppd) for test in tests]
        values = np.stack([np.asarray(f, np.float32) for f in found])
        if np.isnan(values).any():
            raise ValueError(
                f"`metric` must be a number everywhere, got NaN: {metric}."
            )
        return values

    return measure


def _to_tiles(picture: Float[np.ndarray, "height width"]) -> np.ndarray:
    missing = [(0, -side % TILE) for side in picture.shape]
    return np.pad(picture, missing, mode="edge")


def _mostly_seen(seen: Float[np.ndarray, "height width"]) -> np.ndarray:
    """Over the pixels that a tile has: the last of a row may be cut."""
    sums = lambda x: np.add.reduceat(
        np.add.reduceat(x, np.arange(0, x.shape[0], TILE), axis=0),
        np.arange(0, x.shape[1], TILE),
        axis=1,
    )
    return 2 * sums(np.asarray(seen, float)) >= sums(np.ones(seen.shape))


def _stored_type(channel: str) -> type:
    signed = channel.startswith("normal_") or channel == "reflect"
    return np.float16 if signed else np.uint8


def _compact(channel: str, values: np.ndarray) -> np.ndarray:
    kind = _stored_type(channel)
    if kind is np.uint8:
        values = np.rint(values * 255)
    return values.astype(kind)


def _wide(stored: np.ndarray) -> np.ndarray:
    if stored.dtype == np.uint8:
        return stored.astype(np.float32) / np.float32(255)
    return stored.astype(np.float32)
