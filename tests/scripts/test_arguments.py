from __future__ import annotations

from argparse import ArgumentTypeError

import pytest
from arguments import at_least


def test_whole_numbers_have_a_least():
    assert at_least(2, "3") == 3
    for text in ("1", "x", "2.5"):
        with pytest.raises(ArgumentTypeError):
            at_least(2, text)
