"""Shading and refresh rates that buy the most quality for a budget.

Nothing is imported until it is used, so that a command line can answer at once; the
public names are listed in `__init__.pyi`.
"""

import lazy_loader as _lazy


__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
