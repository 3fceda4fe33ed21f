from . import (
    baselines as baselines,
    comparison as comparison,
    datasets as datasets,
    fit as fit,
    plotting as plotting,
    votes as votes,
)
from ._auto import Auto as Auto
from ._columns import TableError as TableError
from ._condition import Terms as Terms
from ._csf import sensitivity as sensitivity
from ._display import (
    Components as Components,
    Display as Display,
    LowPass as LowPass,
    Shading as Shading,
    Viewing as Viewing,
)
from ._exact import Exact as Exact
from ._fidelity import AbstractFidelity as AbstractFidelity, Distortion as Distortion
from ._parameters import (
    Formulation as Formulation,
    load_parameters as load_parameters,
    Parameters as Parameters,
    save_parameters as save_parameters,
)
from ._pooled import Pooled as Pooled
from ._predict import predict as predict
from ._quality import (
    choose_fidelity as choose_fidelity,
    distortion as distortion,
    error_estimate as error_estimate,
    pool as pool,
    pooled_quality as pooled_quality,
    PooledTexture as PooledTexture,
    quality as quality,
)
from ._spectrum import luminance as luminance, Spectrum as Spectrum
