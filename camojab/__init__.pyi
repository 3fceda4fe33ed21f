from . import (
    baselines as baselines,
    comparison as comparison,
    datasets as datasets,
    fit as fit,
    plotting as plotting,
    votes as votes,
)
from ._columns import TableError as TableError
from ._csf import sensitivity as sensitivity
from ._display import (
    Components as Components,
    Display as Display,
    LowPass as LowPass,
    Shading as Shading,
    Viewing as Viewing,
)
from ._parameters import (
    Formulation as Formulation,
    load_parameters as load_parameters,
    Parameters as Parameters,
    save_parameters as save_parameters,
)
from ._predict import predict as predict
from ._quality import (
    Distortion as Distortion,
    distortion as distortion,
    pool as pool,
    Pooled as Pooled,
    pooled_quality as pooled_quality,
    quality as quality,
)
from ._spectrum import luminance as luminance, Spectrum as Spectrum
