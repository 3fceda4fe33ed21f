"""Results on disk, one file each, until all are there."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from camojab._files import DAMAGED, replacing, write_text


class Checkpoint:
    """A folder of arrays by number, thrown away when they belong to another task.

    Without a folder nothing is remembered.
    """

    def __init__(self, folder: str | Path | None, task: Callable[[], str]):
        self._folder = None if folder is None else Path(folder)
        if self._folder is not None:
            _prepare(self._folder, task())

    def read(self, number: int, shape: tuple[int, ...]) -> np.ndarray | None:
        """What was written, or nothing if that is not whole."""
        if self._folder is None:
            return None
        try:
            # An archive has a checksum, which a bare array has not.
            with self._path(self._folder, number).open("rb") as file:
                found = np.load(file, allow_pickle=False)["result"]
        except (OSError, LookupError, *DAMAGED):
            return None
        return found if found.shape == shape and np.isfinite(found).all() else None

    def write(self, number: int, result: np.ndarray) -> None:
        """Remember a result, whole or not at all."""
        if self._folder is not None:
            path = self._path(self._folder, number)
            with replacing(path) as temporary, temporary.open("wb") as file:
                np.savez(file, allow_pickle=False, result=result)

    @staticmethod
    def _path(folder: Path, number: int) -> Path:
        return folder / f"{number:06d}.npz"


def forget(folder: str | Path) -> None:
    """Remove a folder whose results have gone where they belong."""
    if (Path(folder) / _TASK).is_file():
        # Another process of the same job may be at it too.
        shutil.rmtree(folder, ignore_errors=True)


_TASK = "task.txt"


def _prepare(folder: Path, task: str) -> None:
    note = folder / _TASK
    if folder.is_dir() and any(folder.iterdir()):
        if not note.is_file():
            raise ValueError(
                f"`checkpoint` must be a folder of its own, got {folder}, which has "
                "other files."
            )
        if note.read_text(encoding="utf-8").strip() == task:
            return
        for path in folder.glob("*.npz"):
            path.unlink()
    write_text(note, task + "\n")
