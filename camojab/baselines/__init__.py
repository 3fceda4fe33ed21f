"""Models of other authors, with their published constants, to compare with.

Named by author and year: `denes2020` is MARRR, `yang2019` is Nvidia Adaptive Shading.
"""

from ._marrr import (
    Denes2020 as Denes2020,
    MotionQuality as MotionQuality,
    quality_denes2020 as quality_denes2020,
    quality_terms_denes2020 as quality_terms_denes2020,
)
from ._nas import (
    half_rate_error_yang2019 as half_rate_error_yang2019,
    half_rate_motion_yang2019 as half_rate_motion_yang2019,
    pixels_per_frame as pixels_per_frame,
    quality_yang2019 as quality_yang2019,
    quarter_rate_motion_yang2019 as quarter_rate_motion_yang2019,
    rates_yang2019 as rates_yang2019,
    texture_error_yang2019 as texture_error_yang2019,
    threshold_yang2019 as threshold_yang2019,
)
