"""The votes that `camojab scale` can scale, and how their authors scaled them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TYPE_CHECKING

from . import datasets, votes
from ._results import SIMULATED, simulated_note
from ._shipped import shipped


if TYPE_CHECKING:
    import pandas


_JINDAL2021 = (
    "jindal2021/Experiment_Data/vrs_exp_data.csv",
    "jindal2021/Experiment_Data/vrs_exp_data_jnd.mat",
)
_DENES2020 = (
    "denes2020/data/pairwise_comparison_matrices.mat",
    "denes2020/data/exp1_scaled_results.csv",
)


@dataclass(frozen=True)
class Source:
    """Votes, and how they are scaled unless the command line says otherwise.

    - `name`: of the data, as it is shown to people.
    - `files`: that were read, by the names to record them under.
    - `by`, `prior`, `reference`: as in `camojab.votes.scale_groups`.
    - `simulated`: what to say if no person voted.
    - `published`: the column `published_jnd` beside those of the groups and
      `condition`, where somebody scaled the votes before.
    """

    name: str
    cast: "pandas.DataFrame"
    files: Mapping[str, Path]
    by: tuple[str, ...] = ()
    prior: votes.Prior = votes.Prior.NONE
    reference: str | None = None
    simulated: str = ""
    published: "pandas.DataFrame | None" = None


def own_votes(file: Path) -> Source:
    return Source(
        str(file),
        votes.read_votes(file),
        {str(file): file},
        simulated=simulated_note(file),
    )


def _jindal2021() -> Source:
    return Source(
        "Experiment 1 of Jindal et al. 2021",
        votes.votes_jindal2021(),
        {name: datasets.fetch(name) for name in _JINDAL2021},
        by=("block", "velocity_deg_s"),
        prior=votes.Prior.BOUNDED,
        reference="full",
        published=_published_jindal2021(),
    )


def _published_jindal2021() -> Any:
    known: Any = datasets.jindal2021_jnd()
    sizes = [f"{round(1 / rate)}x1" for rate in known["rate_x"]]
    known["condition"] = [
        "full" if size == "1x1" else f"{texture} {size}"
        for texture, size in zip(known["texture"], sizes, strict=True)
    ]
    keys = ["block", "velocity_deg_s", "condition"]
    known = known.rename(columns={"quality_jnd": "published_jnd"})
    return known[[*keys, "published_jnd"]].drop_duplicates(keys)


def _denes2020() -> Source:
    return Source(
        "Experiment 1 of Denes et al. 2020",
        votes.votes_denes2020(),
        {name: datasets.fetch(name) for name in _DENES2020},
        by=("stimulus",),
        prior=votes.Prior.GAUSSIAN,
        reference="50 Hz",
        published=_published_denes2020(),
    )


def _published_denes2020() -> Any:
    known: Any = datasets.denes2020_exp1_all()
    known["condition"] = [f"{rate:g} Hz" for rate in known["refresh_rate_hz"]]
    known = known.rename(columns={"quality_jnd": "published_jnd"})
    return known[["stimulus", "condition", "published_jnd"]]


def _simulated() -> Source:
    file = shipped(SIMULATED)
    return Source(
        "simulated votes",
        datasets.simulated_votes(),
        {SIMULATED: file},
        by=("session",),
        prior=votes.Prior.BOUNDED,
        simulated=simulated_note(file),
    )


SOURCES: Mapping[str, Callable[[], Source]] = {
    "jindal2021": _jindal2021,
    "denes2020": _denes2020,
    "simulated": _simulated,
}
