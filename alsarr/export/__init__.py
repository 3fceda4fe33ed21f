"""Files that engines and people read: rate maps, packed tables and shaders."""

from ._binary import read_binary as read_binary, write_binary as write_binary
from ._hardware_rates import adapt_rates as adapt_rates
from ._rate_images import (
    read_rates_godot as read_rates_godot,
    read_rates_grey as read_rates_grey,
    write_rates_godot as write_rates_godot,
    write_rates_grey as write_rates_grey,
)
from ._rate_json import (
    read_rates_json as read_rates_json,
    write_rates_json as write_rates_json,
)
from ._rate_map import (
    read_rates_bin as read_rates_bin,
    write_rates_bin as write_rates_bin,
    write_rates_png as write_rates_png,
)
from ._records import Records as Records, records as records
from ._shader import (
    LANGUAGES as LANGUAGES,
    shader as shader,
    write_shader as write_shader,
)
from ._texel import (
    read_rgba32f as read_rgba32f,
    Texels as Texels,
    texels as texels,
    write_rgba32f as write_rgba32f,
)
