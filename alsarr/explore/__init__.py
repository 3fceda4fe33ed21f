"""An interactive page: the model under sliders, and the rates it buys for a frame."""

from ._serve import serve as serve
