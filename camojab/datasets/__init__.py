"""Published measurements, textures and displays as tidy tables, units in the names.

Three kinds of data, each with its own way in:

- Public files of the authors of the experiments (`jindal2021_*`, `denes2020_*`), which
  are not part of this package: `fetch` finds them in the folder named by the
  environment variable `CAMOJAB_DATA_DIR`, or else in a cache of the user, to which it
  downloads them once. Every file is checked against its SHA-256 before it is read.
- Small files that travel with the package (`mackin2016`, `itu_bt2246_*`, `displays`).
- Textures drawn or decoded on the spot (`builtin_textures`), which need neither.

Columns have the names that the model's inputs have everywhere else in this package:
`texture`, `mean_luminance_cd_m2`, `refresh_rate_hz`, `velocity_deg_s`, `persistence`,
`ppd`, `rate_x`, `rate_y`, `mip_level`, `quality_jnd`.
"""

from ._denes2020 import (
    denes2020_exp1_all as denes2020_exp1_all,
    denes2020_exp1_comparisons as denes2020_exp1_comparisons,
    denes2020_exp1_jnd as denes2020_exp1_jnd,
    denes2020_exp3_jnd as denes2020_exp3_jnd,
)
from ._displays import displays as displays
from ._jindal2021 import (
    jindal2021_frame as jindal2021_frame,
    jindal2021_jnd as jindal2021_jnd,
    jindal2021_material_tables as jindal2021_material_tables,
    jindal2021_sample_texture as jindal2021_sample_texture,
    jindal2021_textures as jindal2021_textures,
    jindal2021_validation_votes as jindal2021_validation_votes,
    jindal2021_votes as jindal2021_votes,
    Jindal2021Frame as Jindal2021Frame,
    Jindal2021Materials as Jindal2021Materials,
)
from ._literature import (
    itu_bt2246_refresh_rate as itu_bt2246_refresh_rate,
    itu_bt2246_resolution as itu_bt2246_resolution,
    mackin2016 as mackin2016,
)
from ._registry import fetch as fetch, MissingData as MissingData
from ._simulated import (
    simulated_conditions as simulated_conditions,
    simulated_votes as simulated_votes,
)
from ._textures import builtin_textures as builtin_textures
