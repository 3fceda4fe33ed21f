"""Files that engines and people read: rate maps as bytes and as pictures."""

from ._rate_map import (
    read_rates_bin as read_rates_bin,
    write_rates_bin as write_rates_bin,
    write_rates_png as write_rates_png,
)
