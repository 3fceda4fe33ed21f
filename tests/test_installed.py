"""The wheel works outside the checkout, with everything that is in `data/`."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest


ROOT = Path(__file__).parents[1]

# They run in processes of their own, which know nothing of the lane.
pytestmark = pytest.mark.float64


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    pytest.importorskip("hatchling", reason="hatchling builds the wheel")
    folder = tmp_path_factory.mktemp("wheel")
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    (path,) = folder.glob("*.whl")
    return path


def test_data_and_stubs_travel(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    shipped = {
        f"camojab/data/{p.name}" for p in (ROOT / "data").iterdir() if p.is_file()
    }
    assert shipped and shipped <= names
    assert {"camojab/__init__.pyi", "alsarr/__init__.pyi"} <= names
    assert "alsarr/tables/tables.schema.json" in names
    assert not [n for n in names if n.startswith(("tests/", "notebooks/"))]


def test_works_outside_the_checkout(wheel, tmp_path):
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    program = f"""
import camojab, alsarr
from pathlib import Path
site = Path({str(site)!r})
assert Path(camojab.__file__).is_relative_to(site), camojab.__file__
assert Path(alsarr.__file__).is_relative_to(site), alsarr.__file__
for formulation in camojab.Formulation:
    camojab.Parameters.published(formulation)
assert len(camojab.datasets.displays()) and len(camojab.datasets.simulated_votes())
assert len(camojab.datasets.mackin2016()) == 28
spectrum = camojab.Spectrum.from_texture([[0.0, 1.0], [1.0, 0.0]])
display = camojab.Display(ppd=60, refresh_rate=60, luminance=100)
assert camojab.quality(spectrum, display, camojab.Viewing(5.0)) < 0
"""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
