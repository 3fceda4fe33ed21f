"""Quality distilled into polynomials: formula, fitting, lookup and file format."""

from ._distil import distil as distil, Grid as Grid
from ._eq31 import (
    Eq31Fit as Eq31Fit,
    evaluate_eq31 as evaluate_eq31,
    fit_eq31 as fit_eq31,
)
from ._file import load_tables as load_tables, save_tables as save_tables
from ._jindal2021 import TablesJindal2021 as TablesJindal2021
from ._polynomial import Polynomial as Polynomial
from ._tables import (
    AbstractTables as AbstractTables,
    Domain as Domain,
    fit_tables as fit_tables,
    QualityTables as QualityTables,
)
