"""The reference page is what the docstrings say, and lists exactly the public names."""

import importlib
import importlib.util
import inspect
import pkgutil
import re
from pathlib import Path

import pytest

import alsarr
import camojab


FOLDER = Path(__file__).parents[1] / "notebooks"
STORED = (FOLDER / "reference.md").read_text(encoding="utf-8")

# Texts are compared: one lane is enough.
pytestmark = pytest.mark.float64


@pytest.fixture(scope="module")
def page():
    spec = importlib.util.spec_from_file_location("ref", FOLDER / "reference.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.page()


def modules():
    for package in (camojab, alsarr):
        yield package
        for found in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
            if found.ispkg and not found.name.rpartition(".")[2].startswith("_"):
                yield importlib.import_module(found.name)


def public():
    """What importing yields, without reading any source."""
    for module in modules():
        for name in module.__all__ if module in (camojab, alsarr) else vars(module):
            if not name.startswith("_") and not inspect.ismodule(getattr(module, name)):
                yield f"{module.__name__}.{name}"


def test_it_is_what_the_docstrings_say(page):
    assert page == STORED, "`make reference` writes the page anew"


def test_it_lists_exactly_the_public_names():
    listed = re.findall(r"^### (\S+)$", STORED, flags=re.MULTILINE)
    names = list(public())
    assert len(names) > 200
    assert sorted(listed) == sorted(set(names))


def test_the_contents_lead_to_every_name():
    anchors = re.findall(r'^<a id="(\S+)"></a>$', STORED, flags=re.MULTILINE)
    links = re.findall(r"\]\(#(\S+)\)", STORED)
    assert len(set(anchors)) == len(anchors)
    assert sorted(links) == sorted(anchors)
    assert set(anchors) == {*public(), *(module.__name__ for module in modules())}


@pytest.mark.parametrize("name", sorted(public()))
def test_every_name_has_a_signature_and_a_text(name):
    (entry,) = re.findall(
        rf"^### {re.escape(name)}\n(.*?)(?=^<a id=|\Z)", STORED, re.M | re.S
    )
    code, _, text = entry.partition("\n```\n")
    assert code.lstrip().startswith("```python\n")
    assert name.rpartition(".")[2] in code
    assert text.strip(), "has no docstring"
