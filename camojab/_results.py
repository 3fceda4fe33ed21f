"""What a study writes: a folder of files that say where their numbers come from."""

import hashlib
import json
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from typing import Any, TYPE_CHECKING

from ._command import release, Study, Unusable, usable
from ._files import replacing
from ._shipped import shipped


if TYPE_CHECKING:
    import pandas

    from . import fit


SIMULATED = "simulated_votes.csv"
EXPERIMENT = "jindal2021/Experiment_Data"
# What `fit.jindal2021` reads, and the opinion scores that ship.
JINDAL2021 = (
    f"{EXPERIMENT}/vrs_exp_stimulus.mat",
    f"{EXPERIMENT}/vrs_exp_data_jnd.mat",
    f"{EXPERIMENT}/external_data/marrr_exp1_jnds.mat",
    f"{EXPERIMENT}/external_data/marrr_exp1_confidence75.mat",
    f"{EXPERIMENT}/external_data/marrr_exp3_jnds.mat",
)
OPINIONS = (
    "mackin2016.csv",
    "itu_bt2246_refresh_rate.csv",
    "itu_bt2246_resolution.csv",
)


def check_folder(folder: Path, names: Sequence[str]) -> None:
    """Fail before the work rather than after it, if the files could not be written."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise Unusable(f"{there}: must be a folder to write into.")
    if not os.access(there, os.W_OK):
        raise Unusable(f"{there}: must be a folder that may be written into.")
    for name in names:
        if (folder / name).is_dir():
            raise Unusable(f"{folder / name}: must be a file to write, got a folder.")


def save(folder: Path, contents: Mapping[str, str]) -> None:
    """Write the files, each whole, and none of them unless all could be written."""
    with ExitStack() as renamed_at_the_end:
        for name, content in contents.items():
            path = renamed_at_the_end.enter_context(replacing(folder / name))
            path.write_text(content, encoding="utf-8", newline="")


def provenance(
    schema: str, files: Mapping[str, Path], seed: int | None = None
) -> dict[str, Any]:
    """The entries that every JSON file begins with.

    `files` are what was read, by the names to record them under.
    """
    return {
        "schema": schema,
        "camojab": release(),
        "versions": {name: version(name) for name in ("jax", "numpy")},
        "seed": seed,
        "sha256": {name: sha256(path) for name, path in files.items()},
    }


def read_study(own: Study) -> "fit.Comparisons":
    """The votes and conditions of one's own experiment."""
    from . import fit

    with usable({"`encoding`": "`--encoding`"}):
        return fit.read_comparisons(
            own.votes, own.conditions, own.textures, encoding=own.encoding
        )


def study_files(own: Study, textures: Iterable[str]) -> dict[str, Path]:
    """What a study of one's own votes read, by its paths."""
    folder = own.textures or Path()
    found = []
    for name in textures:
        found += [path for path in (Path(name), folder / name) if path.is_file()][:1]
    return {str(path): path for path in (own.votes, own.conditions, *found)}


def quote(data: str, *details: str) -> str:
    """The line to quote beside any number."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("jax", "numpy"))
    return "; ".join([f"camojab {release()}, {versions}", f"data: {data}", *details])


def to_json(document: Mapping[str, Any]) -> str:
    """All digits of every number, and `null` for those that are none."""
    return json.dumps(_plain(document), indent=1, allow_nan=False) + "\n"


def records(frame: "pandas.DataFrame") -> list[dict[str, Any]]:
    """The rows of a table, for `to_json`."""
    columns = {str(name): frame[name].tolist() for name in frame.columns}
    return [
        dict(zip(columns, row, strict=True))
        for row in zip(*columns.values(), strict=True)
    ]


def to_csv(frame: "pandas.DataFrame") -> str:
    """A table whose numbers have all digits, and whose empty cells are not known."""
    # colour-science shortens how pandas prints numbers.
    exact = frame.assign(
        **{
            str(name): [None if x != x else repr(x) for x in column.tolist()]
            for name, column in frame.items()
            if column.dtype.kind == "f"
        }
    )
    return exact.to_csv(index=False, lineterminator="\n")


def simulated_note(votes: Path) -> str:
    """What to say of the shipped votes, which are nobody's; empty for others."""
    if sha256(votes) != sha256(shipped(SIMULATED)):
        return ""
    return "They follow from the published constants."


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
