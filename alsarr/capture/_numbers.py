"""What may be given where a small array of numbers is wanted."""

from collections.abc import Sequence
from typing import Any

from jaxtyping import ArrayLike


Numbers = ArrayLike | Sequence[Any]
"""An array, a number, or (nested) sequences of numbers."""
