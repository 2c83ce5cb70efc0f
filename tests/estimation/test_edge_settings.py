from __future__ import annotations

import pytest

from deshake.estimation.edge_settings import FAINT, SETTINGS, EdgeSetting


def test_names_tell_settings_apart() -> None:
    names = [setting.name for setting in (*SETTINGS, FAINT)]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("setting", [*SETTINGS, FAINT], ids=lambda setting: setting.name)
def test_prices_fall_and_shares_are_shares(setting: EdgeSetting) -> None:
    assert setting.first > setting.last > 0
    assert setting.shocks >= 1
    assert 0 < setting.cut <= setting.carried < 1
    assert setting.most >= 1


def test_the_default_settings_range_from_fine_to_strong() -> None:
    assert [s.last for s in SETTINGS] == sorted(s.last for s in SETTINGS)
    assert [s.shocks for s in SETTINGS] == sorted(s.shocks for s in SETTINGS)
    assert FAINT.cut < min(s.cut for s in SETTINGS)
