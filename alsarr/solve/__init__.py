"""Which shading rate every tile gets: solvers of the multiple-choice knapsack."""

from ._common_threshold import common_threshold as common_threshold
from ._dynamic_programme import dynamic_programme as dynamic_programme
from ._greedy import greedy_jindal2021 as greedy_jindal2021
from ._hull import hull as hull
from ._lagrangian import lagrangian as lagrangian
from ._selection import Selection as Selection
from ._uniform import uniform as uniform
