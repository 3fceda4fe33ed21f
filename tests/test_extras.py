"""What comes only with an extra is asked for in one sentence."""

import sys

import pytest

from camojab import _command
from camojab._extras import MissingExtra, needed


def test_what_is_there_is_imported():
    assert needed("test", "json.decoder", "testing") is sys.modules["json.decoder"]


def test_what_is_missing_is_a_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex.mesh", None)
    sentence = (
        r"^`alsarr\[capture\]` is not installed: tracing rays needs its embreex.$"
    )
    with pytest.raises(MissingExtra, match=sentence):
        needed("capture", "embreex.mesh", "tracing rays")
    with pytest.raises(_command.Unusable, match=sentence), _command.usable():
        needed("capture", "embreex.mesh", "tracing rays")
    # A defect of the program keeps its traceback.
    with pytest.raises(ImportError) as raised, _command.usable():
        raise ImportError("of something else")
    assert not isinstance(raised.value, MissingExtra)
