from __future__ import annotations

import pytest

from deshake.estimation.edge_settings import EAGER, FAINT, SETTINGS, EdgeSetting


def test_names_tell_settings_apart() -> None:
    names = [setting.name for setting in (*SETTINGS, FAINT)]
    assert len(set(names)) == len(names)
    assert {setting.name for setting in SETTINGS} > EAGER


@pytest.mark.parametrize("setting", [*SETTINGS, FAINT], ids=lambda setting: setting.name)
def test_prices_fall_and_shares_are_shares(setting: EdgeSetting) -> None:
    assert setting.first > setting.last > 0
    assert setting.shocks >= 1
    assert 0 < setting.cut <= setting.carried < 1
    assert setting.most >= 1


def test_the_default_settings_differ_in_edges_tails_and_roll() -> None:
    assert len({s.last for s in SETTINGS}) > 1
    assert len({s.cut for s in SETTINGS}) > 1
    assert {s.roll for s in SETTINGS} == {True, False}
    assert len({s.side for s in SETTINGS}) > 1
    assert len({s.gamma for s in SETTINGS}) > 1
    assert FAINT.cut < min(s.cut for s in SETTINGS)
