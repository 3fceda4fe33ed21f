"""Spending a shading budget: one rate for every tile."""

from ._greedy import greedy_jindal2021 as greedy_jindal2021
from ._selection import Selection as Selection
