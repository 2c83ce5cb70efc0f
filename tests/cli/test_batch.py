from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys

import pytest

FAST = ("--focal-35mm", 40, "--blur-size", 3, "--uniform", "--estimator", "edges", "-q")


@pytest.fixture
def folder(sharp_photo, tmp_path):
    """Make a folder of three photos, of which one is bad, and one in a folder in it."""
    place = tmp_path / "in"
    (place / "sub").mkdir(parents=True)
    photo = sharp_photo("p.jpg").rename(place / "p2.jpg")
    shutil.copy(photo, place / "sub" / "q.jpg")
    (place / "p10.jpg").write_text("no photo")
    return place


@pytest.fixture
def shake(folder, shaken):
    """Put a shaken photo in the place of some of the sharp ones."""

    def put(*names):
        photo = shaken("shaken.jpg")
        for name in names:
            shutil.copy(photo, folder / name)
        photo.unlink()

    return put


def test_a_tree_of_photos(deshake, folder, tmp_path):
    out = tmp_path / "out"
    args = ("-r", "-j", 2, "--threads", 1, "--json", "-o", out, *FAST)
    outcome = deshake("fix", folder, *args)
    assert outcome.code == 1
    lines = {line["input"]: line for line in map(json.loads, outcome.out.splitlines())}
    assert set(lines) == {str(folder / name) for name in ("p2.jpg", "p10.jpg", "sub/q.jpg")}
    good = lines[str(folder / "p2.jpg")]
    assert good["status"] == "done"
    assert {"output", "seconds", "extent_px", "confidence", "noise", "warnings"} <= set(good)
    assert (out / "sub" / "q.deshaken.jpg").read_bytes() == (out / "p2.deshaken.jpg").read_bytes()
    assert outcome.err.count("error: ") == 1
    assert "photos:" not in outcome.err  # said with -q: nothing but errors


def test_jobs_and_threads_do_not_change_a_byte(deshake, folder, shake, tmp_path):
    shake("p2.jpg")
    made = []
    for number, words in enumerate((("-j", 1, "--threads", 1), ("-j", 3, "--threads", 2))):
        out = tmp_path / str(number)
        args = ("-r", "-o", out, "--keep-kernels", out, *words, *FAST)
        assert deshake("fix", folder, *args).code == 1
        files = (path for path in out.rglob("*") if path.is_file())
        made.append({path.relative_to(out): path.read_bytes() for path in files})
    assert len(made[0]) == 4
    assert made[0] == made[1]


def test_a_dry_run_prints_and_does_nothing(deshake, folder, tmp_path, contents):
    (folder / "p2.deshaken.jpg").touch()
    before = contents(tmp_path)
    outcome = deshake("fix", folder, "-r", "--dry-run", "--skip-existing")
    assert outcome.code == 0
    assert outcome.out.splitlines() == [
        f"skip {folder}/p2.jpg -> {folder}/p2.deshaken.jpg",
        f"do {folder}/p10.jpg -> {folder}/p10.deshaken.jpg",
        f"do {folder}/sub/q.jpg -> {folder}/sub/q.deshaken.jpg",
    ]
    outcome = deshake("fix", folder, "--dry-run", "--json")
    assert outcome.code == 1
    status = [json.loads(line)["status"] for line in outcome.out.splitlines()]
    assert status == ["failed", "do"]
    assert "exists already" in outcome.err
    assert contents(tmp_path) == before


def test_stages_take_folders_and_give_the_bytes_of_fix(deshake, folder, shake, tmp_path):
    shake("p2.jpg")
    cameras, kernels, sharp, fixed = (tmp_path / name for name in ("c", "k", "s", "f"))
    (folder / "p10.jpg").unlink()
    many = (folder, "-r", "-j", 2, "--threads", 1)
    outcome = deshake("calibrate", *many, "--focal-35mm", 40, "-o", cameras)
    assert outcome.code == 0
    assert [line.count("40.0 mm-equivalent") for line in outcome.out.splitlines()] == [1, 1]
    assert (cameras / "sub" / "q.camera.npz").exists()
    assert deshake("estimate-blind", *many, "-o", kernels, *FAST).code == 0
    assert deshake("deblur", *many, "--kernel", kernels, "-o", sharp).code == 0
    assert deshake("fix", *many, "-o", fixed, *FAST).code == 0
    for name in ("p2.deshaken.jpg", "sub/q.deshaken.jpg"):
        assert (sharp / name).read_bytes() == (fixed / name).read_bytes()
    (kernels / "sub" / "q.kernel.npz").unlink()
    outcome = deshake("deblur", *many, "--kernel", kernels, "-o", sharp, "--overwrite", "--json")
    assert outcome.code == 1
    lines = {line["input"]: line for line in map(json.loads, outcome.out.splitlines())}
    assert lines[str(folder / "p2.jpg")]["kernel"] == str(kernels / "p2.kernel.npz")
    assert "no such file" in lines[str(folder / "sub" / "q.jpg")]["error"]


def test_a_folder_is_not_deblurred_without_kernels(deshake, folder, pan, tmp_path):
    for words in ((folder,), (folder, pan), (folder / "p2.jpg",)):
        outcome = deshake("deblur", *words)
        assert outcome.code == 2
        assert "name one photo and its kernel file, or the kernels with --kernel" in outcome.err
    photo, noisy = folder / "p2.jpg", folder / "sub" / "q.jpg"
    assert deshake("deblur", photo, noisy, "--kernel", pan, "--noisy", noisy).code == 2
    assert deshake("fix", folder, "--mask", noisy).code == 2
    out = tmp_path / "out"
    assert deshake("deblur", photo, noisy, "--kernel", pan, "-o", out, "-q").code == 0
    assert len(list(out.iterdir())) == 2


def test_results_of_other_options_are_reported_and_kept(deshake, folder, pan, tmp_path):
    (folder / "p10.jpg").unlink()
    args = ("deblur", folder, "-r", "--kernel", pan, "-o", tmp_path / "out", "-j", 2)
    assert deshake(*args, "--method", "rl", "--iterations", 2).code == 0
    outcome = deshake(*args, "--method", "rl", "--iterations", 3, "--skip-existing")
    assert outcome.code == 0
    assert outcome.err.count("made with other options (iterations 2, now 3)") == 2
    assert "2 photos: 0 done, 2 skipped, 0 failed; 2 with warnings" in outcome.err
    args = (*args, "--method", "rl", "--iterations", 2, "--skip-existing")
    assert "warning" not in deshake(*args).err


def test_two_runs_into_one_folder_leave_each_others_sheets(folder, pan, tmp_path):
    (folder / "p10.jpg").unlink()
    for number in range(4):
        shutil.copy(folder / "p2.jpg", folder / f"q{number}.jpg")
    out = tmp_path / "out"
    words = ("deblur", folder, "--kernel", pan, "-o", out, "--compare", "--skip-existing", "-j", 1)
    runs = [
        subprocess.Popen([sys.executable, "-m", "deshake", *map(str, words), "-q"])
        for _ in range(2)
    ]
    assert [run.wait(120) for run in runs] == [0, 0]
    names = {f"{path.stem}.deshaken" for path in folder.glob("*.jpg")}
    made = {f"{name}.jpg" for name in names} | {f"{name}.compare.png" for name in names}
    assert {path.name for path in out.iterdir()} == made


def test_a_missing_sheet_is_made_again_and_the_result_stays(deshake, folder, pan, tmp_path):
    photo, out = folder / "p2.jpg", tmp_path / "p.jpg"
    sheet = tmp_path / "p.compare.png"
    args = ("deblur", photo, "--kernel", pan, "-o", out, "--method", "rl", "--compare", "--json")
    assert deshake(*args, "--iterations", 2).code == 0
    drawn, made = sheet.read_bytes(), (out.stat().st_mtime_ns, out.read_bytes())
    sheet.unlink()
    again = (*args, "--skip-existing", "--iterations")
    assert json.loads(deshake(*again, 3).out)["status"] == "skipped"  # not what made the result
    assert not sheet.exists()
    assert json.loads(deshake(*again, 2).out)["status"] == "done"
    assert sheet.read_bytes() == drawn
    assert (out.stat().st_mtime_ns, out.read_bytes()) == made
    assert json.loads(deshake(*again, 2).out)["status"] == "skipped"
    out.unlink()  # a sheet alone is of no use
    assert json.loads(deshake(*again, 3).out)["status"] == "done"
    assert sheet.read_bytes() != drawn


def test_a_sheet_is_not_made_for_a_result_without_provenance(deshake, folder, pan, tmp_path):
    photo, out = folder / "p2.jpg", tmp_path / "p.jpg"
    shutil.copy(photo, out)
    args = ("deblur", photo, "--kernel", pan, "-o", out, "--compare", "--skip-existing")
    outcome = deshake(*args)
    assert outcome.code == 0
    assert "does not say how it was made: its missing sheet cannot be made for it" in outcome.err
    assert not (tmp_path / "p.compare.png").exists()
    assert out.read_bytes() == photo.read_bytes()


def test_too_little_memory_is_reported_for_the_photo(deshake, folder):
    outcome = deshake("fix", folder / "p2.jpg", "--memory", "20M", *FAST)
    assert outcome.code == 1
    assert "of memory, more than --memory 20 MB" in outcome.err
    assert "hint: " in outcome.err
    assert deshake("fix", folder, "--memory", "much").code == 2


def test_the_bar_counts_the_photos(deshake, folder):
    (folder / "p10.jpg").unlink()
    outcome = deshake("fix", folder, "-r", "--progress", *FAST[:-1])
    assert outcome.code == 0
    assert "of 2 photos" in outcome.err
    assert " left" in outcome.err


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_of_many_ends_at_once_and_leaves_nothing(folder, shake, tmp_path, number):
    shake("p2.jpg", "sub/q.jpg")
    out = tmp_path / "out"
    words = ("fix", folder, "-r", "-o", out, "-j", 2, "--threads", 1, "--blur-size", 20, "-v")
    with subprocess.Popen(
        [sys.executable, "-m", "deshake", *map(str, words)],
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        line = process.stderr.readline()  # of the bad photo, while the others are under way
        assert b"not a photo" in line
        if number == signal.SIGINT:  # goes to all of a terminal's processes
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)
        assert process.wait(60) == 128 + number
        assert b"Traceback" not in process.stderr.read()
    assert [path for path in out.rglob("*") if path.is_file()] == []


@pytest.mark.parametrize(
    "case",
    [
        (("fix", "p2.jpg", "-o", "out.bmp"), "out.bmp: no photo format ends in '.bmp'"),
        (("fix", "p2.jpg", "-o", "out"), "out: the name has no ending"),
        (
            ("fix", "p2.jpg", "-o", "out"),
            ".avif or .jp2; the name of a folder ends with a slash: out/\n",
        ),
        (("fix", "p2.jpg", "-o", "none/out.jpg"), "none: no such folder"),
        (
            ("fix", "p2.jpg", "sub", "-o", "none/out"),
            "none/out: the folder cannot be made",
        ),
        (("fix", "p2.jpg", "sub", "-o", "p10.jpg/out"), "p10.jpg/out: the folder cannot be made"),
        (("fix", "gone.jpg"), "gone.jpg: no such file"),
        (("fix", "p2.jpg", "--noisy", "gone.jpg"), "gone.jpg: no such file"),
        (("fix", "p2.jpg", "--mask", "gone.png"), "gone.png: no such file"),
        (("deblur", "p2.jpg", "gone.npz"), "gone.npz: no such file"),
        (("deblur", "p2.jpg", "p2.jpg"), "p2.jpg: no usable kernel file"),
        (("deblur", "p2.jpg", "sub"), "sub/p2.kernel.npz: no such file"),
        (("estimate-blind", "p2.jpg", "--latent", "l.bmp"), "no photo format ends in '.bmp'"),
        (("calibrate", "gone.jpg"), "gone.jpg: no such file"),
    ],
    ids=str,
)
def test_a_dry_run_and_the_run_refuse_the_same(deshake, folder, contents, monkeypatch, case):
    words, what = case
    monkeypatch.chdir(folder)
    before = contents(folder)
    dry = deshake(*words, "--dry-run")
    assert (dry.code, dry.out) == (1, "")
    assert what in dry.err
    blind = words[0] == "fix" and "--noisy" not in words
    assert deshake(*words, *(FAST if blind else ())).err == dry.err
    assert contents(folder) == before


def test_a_dry_run_knows_what_would_be_made(deshake, folder, tmp_path):
    out = tmp_path / "out"
    outcome = deshake("fix", folder, "-r", "--dry-run", "-o", out)
    assert outcome.code == 0
    assert f"do {folder}/sub/q.jpg -> {out}/sub/q.deshaken.jpg" in outcome.out
    assert not out.exists()
    assert deshake("estimate-blind", folder / "p2.jpg", "--dry-run", "--latent", "-").code == 0


@pytest.mark.skipif(sys.platform != "linux", reason="needs names that are no text")
@pytest.mark.parametrize("dry", [(), ("--dry-run",)])
def test_json_has_no_lone_surrogates(deshake, tmp_path, dry):
    place = os.fsencode(tmp_path) + b"/in"
    os.mkdir(place)  # noqa: PTH102
    with open(place + b"/p\xff\xe4.jpg", "wb"):  # noqa: PTH123
        pass
    outcome = deshake("calibrate", tmp_path / "in", "--json", *dry)
    line = json.loads(outcome.out)
    assert line["input"] == f"{tmp_path}/in/p\ufffd\ufffd.jpg"
    outcome.out.encode("utf-8")
    for value in line.values():
        str(value).encode("utf-8")
