"""What tells the quality of every tile of a frame at every shading rate."""

from ._base import AbstractQualityOracle as AbstractQualityOracle
from ._camojab import CamojabOracle as CamojabOracle
from ._cnn import CnnOracle as CnnOracle
from ._denes2020 import Denes2020Oracle as Denes2020Oracle
from ._fidelityfx import FidelityFxOracle as FidelityFxOracle
from ._table import TableOracle as TableOracle
from ._uniform import UniformOracle as UniformOracle
from ._yang2019 import Yang2019Oracle as Yang2019Oracle
