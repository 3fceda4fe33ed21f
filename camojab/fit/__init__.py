"""Fitting the model's constants to what people said."""

from ._least_squares import Fit as Fit, fit as fit
from ._moments import Moments as Moments, moments as moments
from ._observations import (
    jindal2021 as jindal2021,
    Observations as Observations,
    simulated as simulated,
)
