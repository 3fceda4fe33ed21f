"""Pairwise votes: reading and counting them, scaling them to JND, simulating them."""

from ._bootstrap import (
    Bootstrap as Bootstrap,
    bootstrap as bootstrap,
    resample as resample,
)
from ._goodness import (
    goodness_of_fit as goodness_of_fit,
    GoodnessOfFit as GoodnessOfFit,
    residuals as residuals,
)
from ._groups import GroupScaling as GroupScaling, scale_groups as scale_groups
from ._likelihood import Prior as Prior
from ._outliers import outliers as outliers
from ._published import (
    votes_denes2020 as votes_denes2020,
    votes_jindal2021 as votes_jindal2021,
)
from ._scaling import Gauge as Gauge, scale as scale, Scaling as Scaling
from ._simulation import preference as preference, simulate as simulate
from ._tables import read_votes as read_votes
from ._tally import count as count
