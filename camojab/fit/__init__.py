"""Fitting the model's constants to what people said."""

from ._bootstrap import bootstrap as bootstrap, Refits as Refits
from ._comparisons import (
    Comparisons as Comparisons,
    jindal2021_comparisons as jindal2021_comparisons,
    read_comparisons as read_comparisons,
    scaled as scaled,
    simulated as simulated,
    simulated_comparisons as simulated_comparisons,
)
from ._cross_validation import cross_validate as cross_validate
from ._file import describe as describe, save_fit as save_fit
from ._fit import Fit as Fit, fit as fit
from ._moments import Moments as Moments, moments as moments
from ._observations import jindal2021 as jindal2021, Observations as Observations
from ._posterior import Posterior as Posterior, posterior as posterior
from ._profile import Profile as Profile, profile as profile
from ._solvers import Solver as Solver
