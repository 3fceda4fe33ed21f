"""Every Python block of the pages and every code cell of the notebooks runs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[1]

# They run in processes of their own, which know nothing of the lane.
pytestmark = pytest.mark.float64


def _blocks(page):
    return re.findall(r"```python\n(.*?)```", page.read_text(), flags=re.DOTALL)


def _cells(notebook):
    for cell in json.loads(notebook.read_text())["cells"]:
        if cell["cell_type"] == "code":
            yield "".join(cell["source"])


DOCUMENTS = {
    "README.md": _blocks(ROOT / "README.md"),
    **{
        name: _blocks(ROOT / "notebooks" / name)
        for name in ("precision.md", "controller.md", "network.md")
    },
    **{n.name: list(_cells(n)) for n in sorted(ROOT.glob("notebooks/*.ipynb"))},
}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_document_runs(name, tmp_path):
    source = "\n".join(DOCUMENTS[name])
    assert source.strip()
    environment = {**os.environ, "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", source],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
