from __future__ import annotations

import json

from deshake.cli.json_output import print_json


def test_texts_have_no_lone_surrogates_wherever_they_are(capsys):
    report = {
        "name": "p\udcff\udce4.jpg",
        "list": ["\ud800", {"\udc00": ("é \N{CAMERA}", 1.5, None, True)}],
    }
    print_json(report)
    out = capsys.readouterr().out
    assert out.endswith("}\n")
    assert "\\ud800" not in out
    assert json.loads(out) == {
        "name": "p\ufffd\ufffd.jpg",
        "list": ["\ufffd", {"\ufffd": ["é \N{CAMERA}", 1.5, None, True]}],
    }
