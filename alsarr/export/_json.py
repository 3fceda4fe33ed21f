"""What every reader of a JSON file here checks first."""

import json
from pathlib import Path
from typing import Any


def read_object(path: str | Path) -> dict[str, Any]:
    """The one object of a JSON file; `ValueError` naming the file for anything else."""
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: must be JSON: {error}.") from error
    if not isinstance(document, dict):
        raise ValueError(f"{path}: must hold one JSON object.")
    return document


def whole(document: dict[str, Any], name: str, path: str | Path) -> int:
    """A positive whole number of an object."""
    value = document.get(name)
    if type(value) is not int or value < 1:
        raise ValueError(
            f"{path}: `{name}` must be a whole number >= 1, got {value!r}."
        )
    return value
