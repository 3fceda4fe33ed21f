"""Training on disk, so that an interrupted one goes on where it was."""

import json
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from camojab._files import replacing

from ._file import read_archive


SCHEMA = "alsarr-training/2"

_MOST_BYTES = 2**30

_State = TypeVar("_State", bound=PyTree)


def write_checkpoint(path: Path, task: str, state: PyTree, record: Any) -> None:
    """Write the arrays of a state, and a record of numbers, whole or not at all."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(state)]
    header = json.dumps({"schema": SCHEMA, "task": task, "record": record})
    arrays = {f"leaf_{i}": leaf for i, leaf in enumerate(leaves)}
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, header=np.array(header), **arrays)


def read_checkpoint(path: Path, task: str, like: _State) -> tuple[_State, Any] | None:
    """The state and the record that were written, or nothing if there is no file.

    **Raises:** `ValueError` if the file is damaged, or of another task.
    """
    if not path.is_file():
        return None
    try:
        header, arrays = read_archive(path, SCHEMA, _MOST_BYTES)
        if header["task"] != task:
            raise ValueError(
                "`checkpoint` must be of the same network, samples and settings; "
                "remove the file or name another."
            )
        leaves, structure = jax.tree.flatten(like)
        found = [_checked(arrays[f"leaf_{i}"], leaf) for i, leaf in enumerate(leaves)]
        return jax.tree.unflatten(structure, found), header["record"]
    except KeyError as error:
        raise ValueError(f"{path}: lacks {error}.") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _checked(array: np.ndarray, like: Any) -> jax.Array:
    expected = np.asarray(like)
    if array.shape != expected.shape or array.dtype != expected.dtype:
        raise ValueError(f"has an array of {array.dtype}{array.shape}.")
    return jnp.asarray(array)
