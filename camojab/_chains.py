"""The module that evaluates each formulation."""

from types import ModuleType

from . import _paper, _released
from ._parameters import Formulation


# Each has `pool`, `evaluate`, `terms`, `fields`, `on_nodes`, `replica_place`,
# `cell_area` and `FARTHEST`.
CHAIN: dict[Formulation, ModuleType] = {
    Formulation.RELEASED: _released,
    Formulation.PAPER: _paper,
}
