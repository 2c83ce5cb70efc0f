from __future__ import annotations

from argparse import ArgumentTypeError

import pytest
from bench.arguments import at_least, names


def test_whole_numbers_have_a_least():
    assert at_least(2, "3") == 3
    for text in ("1", "x", "2.5"):
        with pytest.raises(ArgumentTypeError):
            at_least(2, text)


def test_names_are_known_ones():
    assert names("a, b", known=("a", "b", "c")) == ["a", "b"]
    with pytest.raises(ArgumentTypeError, match="not among a, b"):
        names("a,x", known=("a", "b"))
