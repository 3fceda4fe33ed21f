"""Quality distilled into polynomials: samples, forms, certificates and files."""

from ._basis import (
    AbstractBasis as AbstractBasis,
    Eq31 as Eq31,
    Eq31LogTravel as Eq31LogTravel,
    TensorPolynomial as TensorPolynomial,
)
from ._certificate import Certificate as Certificate
from ._distil import distil as distil, Form as Form, forms as forms
from ._domain import Conditions as Conditions, Domain as Domain, Grid as Grid
from ._eq31 import (
    Eq31Fit as Eq31Fit,
    evaluate_eq31 as evaluate_eq31,
    fit_eq31 as fit_eq31,
)
from ._file import (
    load_tables as load_tables,
    save_tables as save_tables,
    schema as schema,
)
from ._jindal2021 import TablesJindal2021 as TablesJindal2021
from ._polynomial import Polynomial as Polynomial
from ._rate_order import Constraint as Constraint
from ._samples import sample as sample, Samples as Samples
from ._scene import Scene as Scene
from ._tables import AbstractTables as AbstractTables, QualityTables as QualityTables
