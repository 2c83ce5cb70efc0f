from __future__ import annotations

import math

import pytest

from deshake.api.arguments import check_above_zero, check_kind, check_share
from deshake.errors import DeshakeError


def test_numbers_above_zero_pass():
    check_above_zero(blur_size=1e-9, max_angle=None)
    check_above_zero(most=45, search_angle=45)


@pytest.mark.parametrize("number", [0, -1.0, math.nan, math.inf])
def test_other_numbers_do_not(number):
    with pytest.raises(ValueError, match=rf"blur_size is {number}: it must be above 0$"):
        check_above_zero(blur_size=number)


def test_a_number_has_its_largest():
    with pytest.raises(ValueError, match="search_angle is 46: it must be above 0 and at most 45"):
        check_above_zero(most=45, search_angle=46)


def test_shares_are_from_0_to_1():
    check_share(least_confidence=0, other=None)
    check_share(least_confidence=1.0)
    for share in (-0.01, 1.01, math.nan):
        with pytest.raises(ValueError, match=rf"least_confidence is {share}: it must be from 0"):
            check_share(least_confidence=share)


def test_a_thing_is_of_its_kind():
    assert check_kind(1.5, float, "a number") == 1.5
    with pytest.raises(DeshakeError, match="not a float: str") as caught:
        check_kind("1.5", float, "a number")
    assert caught.value.hint == "a number"
