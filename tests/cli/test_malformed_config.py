"""Malformed configuration files: each is wrong usage, in one line that names the file."""

from __future__ import annotations

import pytest

DEEP, MANY = 3000, 5000

NOT_TOML = {
    "a byte order mark of UTF-16": "threads = 2".encode("utf-16"),
    "UTF-16 without a mark": "threads = 2".encode("utf-16-le"),
    "UTF-32": "threads = 2".encode("utf-32"),
    "two byte order marks": b"\xef\xbb\xbf\xef\xbb\xbfthreads = 2",
    "Latin-1": b"[fix]\nmask = '\xe4'",
    "rubbish": b"\xff\xfe\xfa",
    "NUL at the end": b"threads = 2\0",
    "NUL in a text": b"[fix]\nmask = 'a\0b'",
    "NUL in a text, escaped": b'[fix]\nmask = "a\\u0000b"',
    "half a surrogate pair": b'[fix]\nmask = "\\ud800"',
    "a control character": b"\x01",
    "ends of lines of an old Mac": b"threads = 2\rverbose = 1",
    "nested brackets": b"threads = " + b"[" * DEEP + b"]" * DEEP,
    "brackets that stay open": b"threads = " + b"[" * DEEP,
    "nested tables in a line": b"threads = " + b"{a = " * DEEP + b"1" + b"}" * DEEP,
    "many digits": b"threads = " + b"9" * MANY,
    "many digits in hexadecimal": b"threads = 0x" + b"f" * MANY,
    "many digits in a list": b"[fix]\nregion = [0, 0, 0b" + b"1" * 99_999 + b", 5]",
    "a key twice": b"threads = 2\nthreads = 3",
    "a table twice": b"[fix]\n[fix]\n",
    "a table twice, dotted": b"fix.mask = 'a'\n[fix]\nmask = 'b'",
    "no value": b"threads =",
    "no key": b"= 1",
    "no quotes": b"[fix]\nmask = a.png",
    "a quote that stays open": b"[fix]\nmask = 'a",
    "a table that stays open": b"[fix",
    "JSON": b'{"threads": 2}',
    "YAML": b"threads: 2",
}
NO_SUCH = {
    "an unknown option": b"speed = 1",
    "very many of them": b"\n".join(b"k%d = 1" % number for number in range(MANY)),
    "an unknown option of a command": b"[fix]\nspeed = 1",
    "an unknown command": b"[mend]\nx = 1",
    "a table in a command": b"[fix.extra]\nx = 1",
    "a capital": b"[Fix]\nmask = 'a'",
    "underscores": b"[fix]\nblur_size = 5",
    "dashes": b"[fix]\n'--mask' = 'a'",
    "a short option": b"v = 1",
    "an empty key": b"'' = 1",
    "an empty table": b"['']\nx = 1",
    "a dot in quotes": b"['fix.mask']\nx = 1",
    "very many dots": b".".join([b"a"] * DEEP) + b" = 1",
    "a general option of a command": b"[fix]\nthreads = 2",
    "an option of a command before all tables": b"blur-size = 5",
    "an argument": b"[fix]\nphotos = ['a']",
    "another file": b"config = 'x'",
    "no file": b"no-config = true",
    "the version": b"version = true",
    "the help": b"[fix]\nhelp = true",
    "a command for an option": b"fix = 3",
    "tables of one command": b"[[fix]]\nmask = 'a'",
    "a preset of the whole file": b"preset = 'night'",
    "a preset that is a list": b"preset = ['night']",
    "a preset that is a number": b"[preset]\nnight = 1",
    "presets without names": b"[[preset]]\nx = 1",
    "presets of one name": b"[[preset.night]]\nx = 1",
    "an unknown option of a preset": b"[preset.night]\nspeed = 1",
    "an unknown command of a preset": b"[preset.night.mend]\nx = 1",
    "a preset that takes itself": b"[preset.night]\npreset = 'night'",
    "presets that take each other": b"[preset.a]\npreset = 'b'\n[preset.b]\npreset = 'a'",
    "a preset in a preset": b"[preset.a.preset.b]\nmask = 'x'",
    "a preset of a command": b"[fix]\npreset = 'night'",
}
WRONG = {
    "a date": b"threads = 2020-01-01",
    "a time": b"[fix]\ntransfer = 07:32:00",
    "a date and time": b"threads = 2020-01-01T00:00:00Z",
    "a fraction": b"threads = 1.5",
    "a whole number with a point": b"threads = 2.0",
    "an exponent": b"[fix]\niterations = 1e1",
    "true for a number": b"threads = true",
    "zero": b"threads = 0",
    "below zero": b"threads = -1",
    "more digits than any number needs": b"threads = " + b"9" * 4000,
    "two numbers": b"threads = '2 3'",
    "an empty text for a number": b"threads = ''",
    "a list for a number": b"threads = [1, 2]",
    "a table for a number": b"[fix.blur-size]\na = 1",
    "minus zero": b"[fix]\nblur-size = -0.0",
    "no number": b"[fix]\nstrength = nan",
    "infinity": b"[fix]\nblur-size = inf",
    "minus infinity": b"[fix]\nmax-angle = -inf",
    "a number beyond all numbers": b"[fix]\nblur-size = 1e999",
    "a share below zero": b"[fix]\nstrength = -0.5",
    "a share above one": b"[fix]\nstrength = '180%'",
    "a percentage without its sign": b"[fix]\nstrength = '80'",
    "a list for a share": b"[fix]\nstrength = [1]",
    "three numbers of a region": b"[fix]\nregion = [1, 2, 3]",
    "five of them": b"[fix]\nregion = [1, 2, 3, 4, 5]",
    "none of them": b"[fix]\nregion = []",
    "lists in a list": b"[fix]\nregion = [[1, 2], [3, 4]]",
    "fractions in a list": b"[fix]\nregion = [1.0, 2, 3, 4]",
    "texts in a list": b"[fix]\nregion = ['1', '2', '3', '4']",
    "a region below zero": b"[fix]\nregion = [-1, 2, 3, 4]",
    "a region without pixels": b"[fix]\nregion = [0, 0, 0, 0]",
    "a region beyond any photo": b"[fix]\nregion = [0, 0, 99999999999999999999, 5]",
    "a number for a file": b"[fix]\nmask = 3",
    "a list for a file": b"[fix]\nmask = ['a']",
    "a table for a file": b"[fix.mask]\na = 1",
    "an empty name of a file": b"[fix]\nmask = ''",
    "an empty name of a folder": b"[fix]\nkeep-kernels = ''",
    "an empty name of a log": b"log = ''",
    "a choice that there is not": b"[fix]\nmethod = 'magic'",
    "an empty choice": b"[fix]\nmethod = ''",
    "a list for a choice": b"[fix]\nmethod = ['rl']",
    "a very long text": b"[fix]\nmethod = '" + b"x" * 1_000_000 + b"'",
    "a number for a flag": b"[fix]\nuniform = 1",
    "a text for a flag": b"[fix]\nuniform = 'yes'",
    "a date for a flag": b"[fix]\nuniform = 2020-01-01",
    "memory without a unit": b"[fix]\nmemory = 4000000000",
    "memory in a wrong unit": b"[fix]\nmemory = '4X'",
    "a quality in percent": b"[fix]\njpeg-quality = '90%'",
    "a format that is not written": b"[fix]\nformat = 'gif'",
    "a size of nothing": b"[fix]\nmax-size = 0",
    "a count below zero": b"verbose = -3",
    "a wrong value of another command": b"[inspect]\njobs = 'x'",
    "a wrong value in a preset": b"[preset.night]\nstrength = 3",
    "a wrong value in a command of a preset": b"[preset.night.fix]\nmethod = 'x'",
    "a table in a command of a preset": b"[preset.night.fix.mask]\nx = 1",
}
CASES = NOT_TOML | NO_SUCH | WRONG


def test_every_malformed_file_is_wrong_usage_in_one_line(deshake, shaken, tmp_path):
    photo, path = shaken("a.png"), tmp_path / "own.toml"
    hint = "hint: mend the file, or run without it: deshake --no-config"
    wrong = {}
    for name, content in CASES.items():
        path.write_bytes(content)
        outcome = deshake("--config", path, "fix", "--dry-run", photo)
        error, *more = outcome.err.splitlines()
        one_line = error.startswith(f"error: {path}: ") and len(error) < 1500 and more == [hint]
        if (outcome.code, outcome.out) != (2, "") or not one_line:
            wrong[name] = outcome
    assert wrong == {}


@pytest.mark.parametrize(
    "name", ["nested brackets", "many digits in hexadecimal", "an empty name of a file"]
)
def test_so_is_the_users_own_file(deshake, shaken, tmp_path, monkeypatch, name):
    path = tmp_path / "deshake" / "config.toml"
    path.parent.mkdir()
    path.write_bytes(CASES[name])
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    outcome = deshake("fix", "--dry-run", shaken("a.png"))
    assert outcome.code == 2
    assert outcome.err.startswith(f"error: {path}: ")
    assert deshake("--no-config", "fix", "--dry-run", shaken("a.png")).code == 0


def test_a_folder_a_loop_of_links_and_an_unreadable_file_are_wrong_usage(deshake, tmp_path):
    folder, loop, below = tmp_path / "a.toml", tmp_path / "b.toml", tmp_path / "c.toml" / "d.toml"
    folder.mkdir()
    loop.symlink_to(loop)
    below.parent.write_text("threads = 2")
    for path in (folder, loop, below, tmp_path / "none.toml"):
        outcome = deshake("--config", path, "fix", "--dry-run", "a.png")
        assert outcome.code == 2
        assert outcome.err.startswith(f"error: {path}: ")
        assert len(outcome.err.splitlines()) == 2


@pytest.mark.parametrize(
    "content",
    [b"", b"# nothing\n", b"\xef\xbb\xbfthreads = 2", b"threads = 2\r\nprogress = false\r\n"],
)
def test_odd_but_right_files_are_read(deshake, shaken, tmp_path, content):
    path = tmp_path / "own.toml"
    path.write_bytes(content)
    assert deshake("--config", path, "fix", "--dry-run", shaken("a.png")).code == 0
