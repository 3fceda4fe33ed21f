"""The public surface: what `camojab` offers, and what importing it costs."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import camojab


STUB = ast.parse((Path(camojab.__file__).parent / "__init__.pyi").read_text())
NAMES = sorted(
    alias.asname or alias.name
    for node in STUB.body
    if isinstance(node, ast.ImportFrom)
    for alias in node.names
)

# Each of them takes a second or more to import, and none is needed to answer `--help`.
HEAVY = ["jax", "equinox", "numpy", "pandas", "matplotlib", "colour", "skimage"]


def test_importing_the_package_imports_nothing_heavy():
    program = (
        "import sys; before = set(sys.modules); import camojab; dir(camojab); "
        f"print([m for m in {HEAVY} if m in set(sys.modules) - before])"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]" and run.stderr == ""


def test_the_surface_is_the_stub():
    assert len(NAMES) >= 19
    assert sorted(set(camojab.__all__)) == NAMES
    assert set(NAMES) <= set(dir(camojab))
    assert {"Display", "Viewing", "Spectrum", "Parameters", "Formulation"} < set(NAMES)
    assert {"sensitivity", "distortion", "quality"} < set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_there_and_documented(name):
    value = getattr(camojab, name)
    undocumented = [
        f"{name}.{attribute}"
        for attribute, member in vars(value).items()
        if inspect.isclass(value)
        and not attribute.startswith("_")
        and inspect.isroutine(getattr(value, attribute))
        and member.__doc__ is None
    ]
    assert undocumented == []
    # Without a docstring of its own a class has that of its base, or a made-up one.
    own = vars(value).get("__doc__") if inspect.isclass(value) else value.__doc__
    assert own and not own.startswith(f"{name}(")


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="qualty"):
        _ = camojab.qualty
