"""Modules that only an extra of the distribution brings."""

from importlib import import_module
from typing import Any


class MissingExtra(ImportError):
    """A module is not there because its extra was not installed."""


def needed(extra: str, module: str, task: str) -> Any:
    """Import a module of an extra for a task, such as "training".

    **Raises:** `MissingExtra`, a sentence that says what to install.
    """
    try:
        return import_module(module)
    except ImportError:
        raise MissingExtra(
            f"`alsarr[{extra}]` is not installed: {task} needs its "
            f"{module.partition('.')[0]}."
        ) from None
