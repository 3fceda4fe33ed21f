"""The textures that a table names: from a mapping, a published set or a file."""

import functools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
from jaxtyping import ArrayLike, Float

from . import datasets
from ._spectrum import grey


Source = Callable[[], Float[np.ndarray, "rows columns"]]


def sources(
    names: Iterable[str],
    textures: Mapping[str, ArrayLike],
    encoding: str | None,
    folder: str | Path | None,
) -> tuple[dict[str, Source], dict[str, str]]:
    """How to read the luminance of each texture, and why some have no such way.

    A name is a key of `textures`, `"jindal2021:NAME"`, `"builtin:NAME"`, or the path of
    an image or an array, relative to the working directory or to `folder`. Reading may
    still fail, with `OSError` or `ValueError`.
    """
    libraries = {
        "jindal2021": functools.cache(datasets.jindal2021_textures),
        "builtin": functools.cache(datasets.builtin_textures),
    }

    def source(name: str) -> Source:
        kind, _, key = name.partition(":")
        if name in textures:
            return lambda: grey(textures[name], encoding)
        if kind in libraries:
            library = libraries[kind]()
            if key not in library:
                rule = "one of " + ", ".join(f"{kind}:{known}" for known in library)
                raise ValueError(f"`texture` must be {rule}, got {name!r}.")
            return lambda: grey(library[key], None)
        path = _path(name, folder)
        return lambda: grey(_image(path), encoding)

    found, problems = {}, {}
    for name in names:
        try:
            found[name] = source(name)
        except (OSError, ValueError) as error:
            problems[name] = str(error)
    return found, problems


def folder_textures(
    folder: Path, encoding: str | None
) -> dict[str, Float[np.ndarray, "rows columns"]]:
    """Relative luminance of every image and array of a folder, by name, in its order.

    Names are those of the files without their endings. Hidden files are left out.

    **Raises:** `ValueError` for a folder without files, two files of one name, or one
    that is no image; `OSError`.
    """
    paths = sorted(p for p in folder.iterdir() if p.is_file() and p.name[0] != ".")
    if not paths:
        raise ValueError(f"`textures` must be a folder of images, got {folder}, empty.")
    found = {}
    for path in paths:
        if path.stem in found:
            raise ValueError(f"`textures` must differ in name, got {path.stem} twice.")
        try:
            found[path.stem] = grey(_image(path), encoding)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from error
    return found


def _path(name: str, folder: str | Path | None) -> Path:
    for path in (Path(name), Path(folder or "") / name):
        if path.is_file():
            return path
    raise ValueError(
        "`texture` must be a file, jindal2021:NAME or builtin:NAME, got "
        f"{name!r}, which is no file."
    )


def _image(path: Path) -> np.ndarray:
    try:
        if path.suffix.lower() == ".npy":
            with path.open("rb") as file:
                return np.lib.format.read_array(file, allow_pickle=False)
        import imageio.v3

        # Given a path, imageio leaves files open that it cannot read.
        return imageio.v3.imread(path.read_bytes(), extension=path.suffix)
    # Each decoder has errors of its own for a file that it cannot read.
    except Exception as error:
        raise ValueError(
            f"`texture` must be an image or an array that can be read "
            f"({type(error).__name__})."
        ) from error
