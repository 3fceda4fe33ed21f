"""Pairwise votes: counting them, scaling them to JND, and simulating observers."""

from ._scaling import Prior as Prior, scale as scale, Scaling as Scaling
from ._simulation import preference as preference, simulate as simulate
from ._tables import count as count
