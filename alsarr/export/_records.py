"""Tables as engines index them: one record of coefficients for each polynomial."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from .._rates import nearest_finer, RATES
from ..tables import QualityTables
from ..tables._rate_order import SIDES


BASES = {"eq31": 1, "eq31-log-travel": 2, "tensor": 3}
"""Number of each basis in binary files."""


@dataclass(frozen=True, eq=False)
class Records:
    """Coefficients of every polynomial, in the order that engines index them.

    - `coefficients`: in single precision. Direction is that of the motion: x and y, or
      one for both. Mip levels are the whole ones from 0.
    - `basis`: `"eq31"`, `"eq31-log-travel"` or `"tensor"`.
    - `degrees`, `shortest_travel`: of `alsarr.tables.TensorPolynomial`; (0, 0, 0) and 0
      for other bases.
    - `domain`: lowest and highest velocity [deg/s], refresh rate [Hz] and decimal
      logarithm of luminance [log10(cd/m^2)].
    - `rates`: the seven of `alsarr.RATES`, or `("4", "2", "1")`, the coarse pixel's
      side along the motion, for separable tables.
    - `relative_to`, `model`: as in `alsarr.tables.QualityTables`; the empty string
      where a file does not tell.

    **Raises:** `ValueError` for a shape that does not match the others, a number that
    is not finite, or a domain whose highest is below its lowest.
    """

    coefficients: Float32[np.ndarray, "directions textures mips rates coefficients"]
    basis: str
    degrees: tuple[int, int, int]
    domain: Float32[np.ndarray, "3 2"]
    shortest_travel: float = 0.0
    relative_to: str = ""
    model: str = ""

    def __post_init__(self):
        directions, textures, mips, rates, coefficients = self.coefficients.shape
        if directions not in (1, 2) or rates not in (3, 7) or not textures or not mips:
            raise ValueError(
                "`coefficients` must be of one or two directions, some textures and "
                f"mip levels and 3 or 7 rates, got shape {self.coefficients.shape}."
            )
        if self.basis not in BASES:
            raise ValueError(
                f"`basis` must be one of {', '.join(BASES)}, got {self.basis}."
            )
        expected = 10
        if self.basis == "tensor":
            expected = int(np.prod([degree + 1 for degree in self.degrees]))
        if coefficients != expected:
            raise ValueError(
                f"`coefficients` must be {expected} a polynomial for the basis, got "
                f"{coefficients}."
            )
        if self.basis == "tensor" and not 0 < self.shortest_travel < np.inf:
            raise ValueError(
                f"`shortest_travel` must be > 0 deg, got {self.shortest_travel:g}."
            )
        if not np.isfinite(self.coefficients).all():
            raise ValueError("`coefficients` must be finite in single precision.")
        low, high = self.domain.T
        single = np.finfo(np.float32)
        light = np.log10([single.tiny, single.max])
        good = np.all(low <= high) and 0 <= low[0] and 0 < low[1]
        if not (good and light[0] < low[2] and high[2] < light[1]):
            raise ValueError(
                "`domain` must be lowest and highest of velocities >= 0, refresh rates "
                f"> 0 and luminances in single precision, got {self.domain.tolist()}."
            )

    @property
    def rates(self) -> tuple[str, ...]:
        return SIDES if self.coefficients.shape[3] == len(SIDES) else RATES.names

    @property
    def floats(self) -> int:
        """Numbers of a record: its coefficients and zeros up to whole vectors of 4."""
        return -(-self.coefficients.shape[-1] // 4) * 4

    @property
    def count(self) -> int:
        """How many records there are."""
        return int(np.prod(self.coefficients.shape[:-1]))

    def padded(self) -> Float32[np.ndarray, "records floats"]:
        """Record `((texture * mips + mip) * rates + rate)`, direction x before y."""
        flat = self.coefficients.reshape(self.count, -1)
        return np.pad(flat, ((0, 0), (0, self.floats - flat.shape[1])))


def records(tables: QualityTables) -> Records:
    """The records of tables. A rate that they lack has that of the nearest finer.

    **Raises:** `ValueError` for a mip level that is no whole number, and for a number
    that is not finite in single precision.
    """
    coefficients = np.asarray(tables.dense(), np.float32)
    if tables.rates != SIDES:
        place = [
            tables.rates.index(RATES.names[i]) for i in nearest_finer(tables.rates)
        ]
        coefficients = coefficients[:, :, :, place]
    domain = tables.domain
    ends = (domain.velocity, domain.refresh_rate, domain.log10_luminance)
    return Records(
        coefficients=coefficients,
        basis=tables.basis.name,
        degrees=getattr(tables.basis, "degrees", (0, 0, 0)),
        shortest_travel=getattr(tables.basis, "shortest_travel", 0.0),
        domain=np.array([np.asarray(x) for x in ends], np.float32),
        relative_to=tables.relative_to or "",
        model=tables.model,
    )
