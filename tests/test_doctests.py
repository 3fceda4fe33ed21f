"""The examples of the docstrings print what they say, in either precision."""

import doctest
import importlib
import re
from pathlib import Path

import numpy as np
import pytest


ROOT = Path(__file__).parents[1]


def _examples():
    """Modules with examples, and how many lines of input each has."""
    for package in ("camojab", "alsarr"):
        for path in sorted((ROOT / package).rglob("*.py")):
            inputs = re.findall(r"^ +>>> ", path.read_text(), flags=re.MULTILINE)
            if inputs:
                parts = path.relative_to(ROOT).with_suffix("").parts
                yield ".".join(parts), len(inputs)


EXAMPLES = dict(_examples())


def _found(name):
    finder = doctest.DocTestFinder(exclude_empty=True)
    tests = finder.find(importlib.import_module(name))
    return [test for test in tests if test.examples]


def test_there_are_examples():
    assert len(EXAMPLES) > 15


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_of(name):
    tests = _found(name)
    # A decorator may hide a docstring from the finder.
    assert sum(len(test.examples) for test in tests) == EXAMPLES[name]
    runner = doctest.DocTestRunner(verbose=False)
    report = []
    # As a new process prints, whatever other tests have imported into this one.
    with np.printoptions(legacy=False):
        for test in tests:
            runner.run(test, out=report.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(report)
