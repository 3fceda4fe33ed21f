"""Every notebook runs from top to bottom, and is stored as it ran."""

import importlib.util
import json
import os
import re
from pathlib import Path

import nbformat
import numpy as np
import pytest


FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))

# In this one the published data take the place of the built-in; elsewhere they add.
REPLACED = "01_start_here"

# They run in processes of their own, which know nothing of the lane.
pytestmark = pytest.mark.float64

# Every figure is kept, whether pyplot knows of it or not.
BEGIN = """
import warnings
from matplotlib.figure import Figure

every_figure_ = []

def remembering(self, *args, _begin=Figure.__init__, **kwargs):
    _begin(self, *args, **kwargs)
    every_figure_.append(self)

Figure.__init__ = remembering
warnings.simplefilter("error")
"""

END = """
def unlabelled(axes):
    figure = axes.get_figure(root=True)
    # The bar of a picture may leave what it measures, and its unit, to the title.
    bar = getattr(axes, "_colorbar", None)
    if bar is not None and "[" in bar.mappable.axes.get_title():
        return
    for name, first, second in (("x", "bottom", "top"), ("y", "left", "right")):
        axis = getattr(axes, name + "axis")
        shown = axis.get_tick_params()
        ticks = shown.get("label" + first) or shown.get("label" + second)
        ticks = ticks and len(axis.get_ticklocs()) and axis.get_visible()
        shared = [figure, *figure.subfigs]
        texts = [axis.get_label_text()]
        texts += [getattr(f, f"get_sup{name}label")() for f in shared]
        if ticks and axes.axison and not any(texts):
            yield f"{name} of {axes.get_title() or axes!r}"

bare = [
    text
    for figure in every_figure_
    for axes in figure.axes
    if axes.get_visible()
    for text in unlabelled(axes)
]
assert every_figure_ and not bare, f"without a label: {bare}"
"""


@pytest.fixture(scope="module")
def executor():
    spec = importlib.util.spec_from_file_location("execute", FOLDER / "execute.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def environment(folder, real):
    # Compiled as users do, and not as tests are.
    without = ("CAMOJAB_DATA_DIR", "XLA_FLAGS")
    kept = {k: v for k, v in os.environ.items() if k not in without}
    if real:
        kept["CAMOJAB_DATA_DIR"] = os.environ["CAMOJAB_DATA_DIR"]
    # The history of a kernel is none of the user's.
    return {**kept, "IPYTHONDIR": str(folder / "ipython")}


def quoted(notebook):
    """What the last cell printed, without what is of a version."""
    (*_, last) = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    texts = ["".join(o["text"]) for o in last["outputs"] if "text" in o]
    return re.sub(r"(alsarr|camojab|jax) [\d.]+", r"\1", "".join(texts))


def apart(text):
    """A text's words, and its numbers."""
    number = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
    return re.sub(number, "#", text), [float(x) for x in re.findall(number, text)]


def run(executor, path, folder, real=False):
    notebook = nbformat.read(path, as_version=4)
    cell = nbformat.v4.new_code_cell
    notebook.cells = [cell(BEGIN), *notebook.cells, cell(END)]
    work = folder / "work"
    work.mkdir()
    executor.execute(
        notebook,
        work,
        environment(folder, real),
        timeout=120,
        connection_file=str(folder / "kernel.json"),
    )
    del notebook.cells[-1]
    return notebook


def test_there_are_notebooks():
    readme = (FOLDER.parent / "README.md").read_text()
    listed = re.findall(r"\(notebooks/(\w+\.ipynb)\)", readme)
    assert len(listed) == 8 and [path.name for path in NOTEBOOKS] == listed


def runs():
    """Notebooks, with the published data where they have use for it and it is here."""
    for path in NOTEBOOKS:
        real = "CAMOJAB_DATA_DIR" in os.environ and "_DATA_DIR" in path.read_text()
        if not real or path.stem == REPLACED:
            yield pytest.param(path, False, id=path.stem)
        if real:
            yield pytest.param(path, True, id=f"{path.stem}-real")


@pytest.mark.parametrize("path, real", list(runs()))
def test_runs_and_is_quoted_as_it_runs(executor, path, real, tmp_path):
    ran = run(executor, path, tmp_path, real)
    if real and path.stem == REPLACED:
        return
    words, numbers = apart(quoted(ran))
    stored_words, stored_numbers = apart(quoted(nbformat.read(path, as_version=4)))
    assert words == stored_words and numbers
    # Other processors round in other ways, which training makes more of.
    np.testing.assert_allclose(numbers, stored_numbers, rtol=0.1, atol=0.1)


@pytest.mark.parametrize(
    "source, message",
    [
        ("import warnings; warnings.warn('careless')", "careless"),
        ("import matplotlib.pyplot as plt; plt.plot([0, 1])", "without a label"),
        ("import matplotlib.pyplot as plt; plt.figure(); 1 / 0", "ZeroDivisionError"),
    ],
)
def test_what_is_wrong_is_found(executor, tmp_path, source, message):
    path = tmp_path / "wrong.ipynb"
    cells = [nbformat.v4.new_code_cell(source)]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), path)
    with pytest.raises(Exception, match=message):
        run(executor, path, tmp_path)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_is_stored_as_it_ran(executor, path):
    text = path.read_text()
    stored = json.loads(text)
    assert len(text) < 500_000
    assert stored["metadata"] == executor.METADATA
    assert (stored["nbformat"], stored["nbformat_minor"]) == (4, 5)
    assert all(cell["metadata"] == {} and cell["id"] for cell in stored["cells"])

    code = [cell for cell in stored["cells"] if cell["cell_type"] == "code"]
    counts = [cell["execution_count"] for cell in code]
    assert counts == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert "error" not in {output["output_type"] for output in outputs}
    assert "stderr" not in {output.get("name") for output in outputs}
    shown = [output["data"] for output in outputs if "data" in output]
    pictures = [d.pop(f"image/{kind}", None) for d in shown for kind in ("png", "jpeg")]
    assert any(pictures)
    # The pictures are out, whose letters may spell anything.
    assert not re.search(r"/(tmp|work|root|home|Users)\b", json.dumps(stored))
