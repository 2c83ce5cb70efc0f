from __future__ import annotations

import pytest

from deshake.blind.entry import Entry
from deshake.blind.finish import Finish
from deshake.blind.trust import confidence, two_digits


@pytest.fixture(scope="module")
def ended(shaken) -> Finish:
    """A race that the true kernel won, some twelve pixels wide."""
    return Finish(
        Entry("true", 3, 0, shaken.kernel), margin=0.05, match=0.1, agreement=0.9, at_rest=False
    )


@pytest.mark.parametrize("margin", [-1.0, 0.0, 0.02, 0.2, 5.0])
@pytest.mark.parametrize("agreement", [0.0, 0.8, 1.0, 1.0 + 1e-9])
def test_it_is_a_chance(ended, margin, agreement) -> None:
    assert 0 <= confidence(ended._replace(margin=margin, agreement=agreement)) <= 1


@pytest.mark.parametrize("agreement", [0.5, 0.8, 0.95])
def test_it_rises_with_the_margin(ended, agreement) -> None:
    chances = [
        confidence(ended._replace(margin=margin, agreement=agreement))
        for margin in (-0.1, 0.0, 0.01, 0.02, 0.05, 0.1, 0.3)
    ]
    assert chances == sorted(chances)
    assert chances[0] < chances[-1]


@pytest.mark.parametrize("margin", [0.0, 0.02, 0.05])
def test_it_rises_with_the_agreement(ended, margin) -> None:
    chances = [
        confidence(ended._replace(margin=margin, agreement=agreement))
        for agreement in (0.1, 0.4, 0.6, 0.8, 0.9, 1.0)
    ]
    assert chances == sorted(chances)
    assert chances[0] < chances[-1]


def test_it_rises_with_the_match_of_the_spectra(ended) -> None:
    chances = [confidence(ended._replace(match=match)) for match in (-0.1, 0.0, 0.1, 0.3, 0.5)]
    assert chances == sorted(chances)
    assert chances[0] == chances[1] < 0.3
    assert 0.9 < chances[-1] < 1


def test_it_rises_with_the_lead_over_turned_kernels(ended) -> None:
    leads = (-0.1, 0.0, 0.03, 0.06, 0.09, 0.5)
    chances = [confidence(ended._replace(lead=lead)) for lead in leads]
    assert chances == sorted(chances)
    unknown = confidence(ended)
    assert chances[2] < unknown / 10
    assert chances[3] < unknown < chances[4]


def test_a_kernel_without_a_lead_is_never_trusted(ended) -> None:
    """The other terms of a photo out of focus may speak for its kernel."""
    best = ended._replace(margin=0.1, match=0.25, agreement=0.98)
    assert confidence(best) > 0.95
    assert confidence(best._replace(lead=0.0)) < 0.5


def test_where_nothing_moved_there_is_nothing_to_trust(ended) -> None:
    assert confidence(ended._replace(at_rest=True)) == 0


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.7999, "0.79"), (0.8, "0.80"), (0.897, "0.89"), (0.29, "0.29"), (1, "1.00")],
)
def test_a_confidence_is_never_shown_as_more_than_it_is(value, shown):
    assert two_digits(value) == shown
