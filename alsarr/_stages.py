"""Stages of a job whose results are kept: what did not change is not done again."""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeGuard

import jax
import numpy as np

from camojab._files import write_text


Result = dict[str, Any]


class Stages:
    """Remembers, in one folder, what each stage was given, made and found.

    The record is written after every stage, so an interrupted job goes on where it
    was. A stage whose inputs, or whose files, changed is done again.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self._record = folder / "run.json"
        self._known = _read(self._record)

    def run(
        self,
        name: str,
        inputs: Sequence[object],
        files: Sequence[str],
        compute: Callable[[], Result],
    ) -> tuple[Result, bool]:
        """Result of a stage, and whether it had to be computed.

        `inputs` are arrays, tables, pytrees, text and numbers; `files` are what
        `compute` writes into the folder; its result must go into JSON.
        """
        key = digest(*inputs)
        known = self._known.get(name)
        if _is_entry(known) and known["inputs"] == key:
            if self._intact(known["files"], files):
                return known["result"], False
        result = compute()
        made = {file: _checksum(self.folder / file) for file in files}
        self._known[name] = {"inputs": key, "files": made, "result": result}
        write_text(self._record, json.dumps(self._known, indent=1) + "\n")
        return result, True

    def _intact(self, known: dict[str, str], files: Sequence[str]) -> bool:
        if sorted(known) != sorted(files):
            return False
        paths = {self.folder / file: sha for file, sha in known.items()}
        return all(p.is_file() and _checksum(p) == sha for p, sha in paths.items())


def digest(*parts: object) -> str:
    """SHA-256 of arrays, tables, pytrees, text and numbers, in order."""
    sha = hashlib.sha256()
    for part in parts:
        if hasattr(part, "to_csv"):
            # All digits: colour-science shortens how NumPy prints numbers.
            text = part.to_csv(index=False, float_format="%.17g")  # pyright: ignore
            sha.update(text.encode())
            continue
        leaves, structure = jax.tree.flatten(part)
        sha.update(str(structure).encode())
        for leaf in leaves:
            array = np.asarray(leaf)
            sha.update(f"{array.dtype}{array.shape}".encode())
            sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()


def _is_entry(known: Any) -> TypeGuard[dict[str, Any]]:
    """Whether an entry of the record has its parts; another one is done again."""
    kinds = {"inputs": str, "files": dict, "result": dict}
    return isinstance(known, dict) and all(
        isinstance(known.get(name), kind) for name, kind in kinds.items()
    )


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _read(path: Path) -> dict[str, Any]:
    # A damaged record only costs doing the work again.
    try:
        known = json.loads(path.read_text())
    except (FileNotFoundError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}
