"""Options that several commands have, and what is read from their text."""

import re
from pathlib import Path
from typing import Annotated

import typer


Captures = Annotated[
    list[Path],
    typer.Argument(help="Folders with views, as alsarr capture writes them."),
]

Networks = Annotated[
    list[Path] | None,
    typer.Option(
        help="NPZ file of a network. May be given several times. Those for FLIP and "
        "JNFLIP that are shipped, if left out."
    ),
]


def size(text: str, option: str) -> tuple[int, int]:
    """Width and height in pixels."""
    match = re.fullmatch(r"([1-9]\d{0,4})x([1-9]\d{0,4})", text)
    if match is None:
        raise typer.BadParameter(
            f"must be a width and a height >= 1 px such as 640x368, got {text}.",
            param_hint=f"'{option}'",
        )
    return int(match[1]), int(match[2])


def counts(text: str, option: str) -> tuple[int, ...]:
    """Whole numbers > 0."""
    if re.fullmatch(r"[1-9]\d*(,[1-9]\d*)*", text) is None:
        raise typer.BadParameter(
            f"must be whole numbers > 0 with commas between, got {text}.",
            param_hint=f"'{option}'",
        )
    return tuple(map(int, text.split(",")))
