"""What tells the quality of every tile of a frame at every shading rate."""

from ._base import AbstractQualityOracle as AbstractQualityOracle
from ._table import TableOracle as TableOracle
