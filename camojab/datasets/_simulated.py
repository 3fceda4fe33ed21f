"""Votes of a simulated observer on the built-in textures; no person took part."""

from typing import TYPE_CHECKING

from .._shipped import shipped


if TYPE_CHECKING:
    import pandas


def simulated_conditions() -> "pandas.DataFrame":
    """The conditions that the simulated observer voted on.

    Columns: the model's conditions, as `camojab predict` names them; `session`, within
    which conditions were compared; `condition`, its name there; `data_set`, `block`
    and `temporal_only` as in `camojab.fit.Observations`; `reference`, the row number
    that quality is relative to; `true_quality_jnd`, the quality that the votes were
    drawn from.

    **Source:** `data/simulate_votes.py`, from the published constants, seed 20211210.
    """
    import pandas

    return pandas.read_csv(shipped("simulated_conditions.csv"))


def simulated_votes() -> "pandas.DataFrame":
    """One row a vote: observer, session, condition_a, condition_b, a_preferred.

    **Source:** a Thurstone Case V observer (`data/simulate_votes.py`, seed 20211210);
    14 simulated observers compare every pair of a session once.
    """
    import pandas

    votes = pandas.read_csv(shipped("simulated_votes.csv"))
    return votes.assign(a_preferred=votes["a_preferred"].astype(bool))
