"""The report through the real command line, on photos whose kernels are known."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from PIL import Image
from skimage import data

from deshake.cli.main import main
from deshake.files.kernel_file import KernelFile, read_kernel, write_kernel
from deshake.geometry.kernel import RotationKernel

pytestmark = pytest.mark.long

QUICK = ("--method", "rl", "--iterations", 2)
HOSTILE = '<b onclick="x">&amp; \'é.png'


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """Two photos that were shaken by known kernels, one of them with a hostile name."""
    top = tmp_path_factory.mktemp("shaken")
    for name in ("sharp", "in", "kernels"):
        (top / name).mkdir()
    pictures = {
        HOSTILE: data.astronaut()[:200:2, :300:2],
        "plain.png": data.coffee()[:200:2, :300:2],
    }
    for seed, (name, picture) in enumerate(pictures.items()):
        Image.fromarray(picture).save(top / "sharp" / name)
        kernel = top / "kernels" / f"{name.removesuffix('.png')}.kernel.npz"
        words = ["-o", top / "in" / name, "--kernel", kernel, "--seed", seed, "--focal-35mm", 35]
        assert main(list(map(str, ["simulate", top / "sharp" / name, *words]))) == 0
    return top


@pytest.fixture
def folder(known, tmp_path):
    """The shaken photos; their kernels are beside the folder."""
    for name in ("in", "kernels"):
        shutil.copytree(known / name, tmp_path / name)
    return tmp_path / "in"


@pytest.fixture
def deblur(deshake, folder, tmp_path):
    """Deblur the folder with the known kernels."""

    def run(*args, photos=folder, kernels=tmp_path / "kernels"):
        words = ("--kernel", kernels, "-o", tmp_path / "out", *QUICK)
        return deshake("deblur", photos, *words, *args)

    return run


class Page(HTMLParser):
    """Collects the elements of a page and its words."""

    def __init__(self, path):
        super().__init__()
        self.elements, self.words, self.addresses = [], "", []
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attrs):
        self.elements.append(tag)
        self.addresses += [value for name, value in attrs if name in {"src", "href"}]

    def handle_data(self, data):
        self.words += data


def without_times(path):
    text = path.read_text("utf-8")
    text = re.sub(r'data-key="\d+\.\d">\d+\.\d<', 'data-key="T">T<', text)
    return re.sub(r"<dt>Time</dt><dd>\d+\.\d s</dd>", "<dt>Time</dt>", text)


def test_a_folder_of_photos_on_one_page(deblur, tmp_path):
    outcome = deblur("--report", tmp_path / "look.html")
    assert (outcome.code, outcome.out) == (0, "")
    assert f"report: {tmp_path / 'look.html'}\n" in outcome.err
    page = Page(tmp_path / "look.html")
    assert page.elements.count("article") == 2
    assert "b" not in page.elements
    assert "2 improved" in page.words
    assert "Made by deshake deblur " in page.words
    assert HOSTILE in page.words
    kernel = read_kernel(tmp_path / "kernels" / "plain.kernel.npz").kernel
    assert f"{kernel.extent_px():.1f} px over the frame" in page.words
    assert "confident (1.00)" in page.words
    local = [each for each in page.addresses if not each.startswith(("data:image/", "#p"))]
    assert "out/plain.deshaken.png" in local
    assert len(local) == 2
    assert not any("://" in each for each in page.addresses)
    assert (tmp_path / "look.html").stat().st_size < 1_000_000


def test_each_photo_has_the_command_that_makes_it_again(deblur, deshake, tmp_path):
    assert deblur("--report", tmp_path / "look.html", "-j", 1, "--strength", 0.8).code == 0
    words = Page(tmp_path / "look.html").words
    commands = re.findall(r"Command(deshake deblur .*)", words)
    assert len(commands) == 2
    for command in commands:
        _, *args = shlex.split(command)
        assert args[-6:] == ["--method", "rl", "--iterations", "2", "--strength", "0.8"]
        result = Path(args[args.index("-o") + 1])
        before = result.read_bytes()
        result.unlink()
        assert deshake(*args).code == 0
        assert result.read_bytes() == before


def test_equal_inputs_give_equal_pages_save_for_the_times(deblur, tmp_path):
    pages = []
    for number in "12":
        assert deblur("--report", tmp_path / "look.html", "--overwrite", "-j", number).code == 0
        pages.append(without_times(tmp_path / "look.html").replace(f"-j {number}", "-j"))
    assert pages[0] == pages[1]


def test_one_photo_and_a_folder_for_its_page(deblur, folder, tmp_path):
    (tmp_path / "out").mkdir()
    kernel = tmp_path / "kernels" / "plain.kernel.npz"
    outcome = deblur("--report", tmp_path / "page", photos=folder / "plain.png", kernels=kernel)
    assert outcome.code == 0
    page = Page(tmp_path / "page" / "report.html")
    assert page.elements.count("article") == 1
    assert "table" not in page.elements
    assert "../out/plain.deshaken.png" in page.addresses


def test_pictures_beside_the_page(deblur, tmp_path):
    outcome = deblur("--report", tmp_path / "look.html", "--report-images")
    assert outcome.code == 0
    page = Page(tmp_path / "look.html")
    pictures = {path.name for path in (tmp_path / "look-pictures").iterdir()}
    assert len(pictures) == 10
    shown = {Path(each).name for each in page.addresses if "look-pictures" in each}
    assert shown <= pictures
    assert len(shown) == 6
    assert (tmp_path / "look.html").stat().st_size < 40_000


def test_pictures_of_a_report_are_no_photos_of_the_folder(deblur, folder):
    words = ("--report", folder / "look.html", "--report-images", "--overwrite", "-r")
    for _ in range(2):
        assert "2 photos: 2 done" in deblur(*words).err


def test_photos_that_fail_or_are_left_are_distinguished(deblur, folder, tmp_path):
    kernel = tmp_path / "kernels" / "plain.kernel.npz"
    (tmp_path / "kernels" / "other.kernel.npz").write_bytes(kernel.read_bytes())
    still = RotationKernel.delta(read_kernel(kernel).kernel.camera)
    notes = {"notes": ["no focal length", "the photo looks sharp: it is left as it is"]}
    kernel.unlink()
    write_kernel(kernel, KernelFile(still, 0.1, notes))
    (folder / "other.png").write_text("no photo")
    outcome = deblur("--report", tmp_path / "look.html", "--json")
    assert outcome.code == 1
    assert "3 photos: 1 done, 1 left as it is, 0 skipped, 1 failed" in outcome.err
    page = Page(tmp_path / "look.html")
    assert "1 improved, 1 left as it is, 1 failed" in page.words
    assert "Left as it is: the photo looks sharp" in page.words
    lines = {Path(line["input"]).name: line for line in map(json.loads, outcome.out.splitlines())}
    assert lines["plain.png"]["verdict"] == "left"
    assert lines["plain.png"]["reason"] == "the photo looks sharp"
    assert lines[HOSTILE]["verdict"] == "improved"
    assert "pictures" not in lines[HOSTILE]
    assert lines["other.png"]["error"].removeprefix(f"{folder / 'other.png'}: ") in page.words


def test_an_existing_page_is_refused_before_any_work(deblur, tmp_path):
    (tmp_path / "look.html").write_text("mine")
    outcome = deblur("--report", tmp_path / "look.html")
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err == (
        f"error: {tmp_path / 'look.html'}: exists already\n"
        "hint: choose another place with --report, or allow replacing it with --overwrite\n"
    )
    assert (tmp_path / "look.html").read_text() == "mine"
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("more", [(), ("--dry-run",)])
def test_a_link_that_leads_nowhere_is_no_folder_for_a_page(deblur, tmp_path, more):
    link = tmp_path / "loop"
    link.symlink_to(link)
    outcome = deblur("--report", link, *more)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err == (
        f"error: {link}: is not a folder\nhint: choose another place with --report\n"
    )


def test_no_page_takes_the_place_of_a_photo(deblur, folder, tmp_path):
    photo = folder / "plain.png"
    page = tmp_path / "out.html"
    os.link(photo, page)
    outcome = deblur("--report", page, "--overwrite", photos=photo)
    assert outcome.code == 1
    assert "is a photo or an output of this run" in outcome.err
    assert page.samefile(photo)


def test_a_page_without_a_folder(deblur, tmp_path):
    outcome = deblur("--report", tmp_path / "no" / "such" / "page.html")
    assert outcome.code == 1
    assert "no such folder\nhint: choose another place with --report\n" in outcome.err


def test_a_dry_run_writes_no_page(deblur, tmp_path):
    assert deblur("--report", tmp_path / "page", "--dry-run").code == 0
    assert not (tmp_path / "page").exists()


def test_skipped_photos_are_on_the_page_of_a_second_run(deblur, tmp_path):
    assert deblur().code == 0
    assert deblur("--skip-existing", "--report", tmp_path / "look.html").code == 0
    assert "2 skipped" in Page(tmp_path / "look.html").words


@pytest.mark.parametrize(
    ("args", "what"),
    [
        (("--report-images",), "--report-images needs --report."),
        (("--open",), "--open needs --report or --compare."),
        (("--open", "--compare"), "--open opens one photo's sheet; for several, add --report"),
        (("--report", "-"), "the report is not written to standard output: name a file"),
    ],
)
def test_wrong_usage(deshake, folder, tmp_path, args, what):
    for command in ("fix", "deblur"):
        kernels = () if command == "fix" else ("--kernel", tmp_path / "kernels")
        outcome = deshake(command, folder, *kernels, "-o", tmp_path / "out", *args)
        assert (outcome.code, outcome.out) == (2, "")
        assert outcome.err == f"error: {what}\nhint: see deshake {command} --help\n"
    assert not list(tmp_path.glob("out/*"))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere another program opens files")
@pytest.mark.parametrize(
    ("args", "name"),
    [(("--report", "look.html"), "look.html"), (("--compare",), "out/plain.deshaken.compare.png")],
)
def test_open_opens_the_page_or_the_sheet(folder, tmp_path, args, name):
    programs = tmp_path / "bin"
    programs.mkdir()
    opener = programs / "xdg-open"
    opener.write_text(
        f'#!/bin/sh\necho "$1" > {tmp_path}/part && mv {tmp_path}/part {tmp_path}/opened\n'
    )
    opener.chmod(0o755)
    (tmp_path / "out").mkdir()
    words = [folder / "plain.png", tmp_path / "kernels" / "plain.kernel.npz", "-o", "out", *QUICK]
    done = subprocess.run(
        [sys.executable, "-m", "deshake", "deblur", *map(str, words), *args, "--open"],
        cwd=tmp_path,
        env=os.environ | {"PATH": f"{programs}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    for _ in range(100):
        if (tmp_path / "opened").exists():
            break
        subprocess.run(["sleep", "0.05"], check=True)
    assert (tmp_path / "opened").read_text() == f"{tmp_path / name}\n"


def test_what_was_done_stands_on_a_line_unless_quiet(deshake, shaken, sharp_photo, tmp_path):
    large = shaken("large.jpg", large=True, size=(150, 120))
    photos = {
        sharp_photo("sharp.jpg"): (3, "10,5,80,70", "left as it is: the photo looks sharp"),
        large: (9, "20,10,110,100", r"shake of [\d.]+ px, \w.*"),
    }
    for photo, (size, region, said) in photos.items():
        args = ("fix", photo, "--blur-size", size, "--uniform", "--region", region, *QUICK)
        outcome = deshake(*args)
        assert outcome.code == 0
        lines = [each for each in outcome.err.splitlines() if not each.startswith("warning: ")]
        assert len(lines) == 1
        result = tmp_path / f"{photo.stem}.deshaken.jpg"
        assert re.fullmatch(f"{photo} -> {result}: {said}", lines[0])
        if size == 3:
            quiet = deshake(*args, "-q", "--overwrite")
            assert (quiet.code, quiet.out, quiet.err) == (0, "", "")


@pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")
def test_a_page_takes_the_permissions_that_all_its_photos_have(deblur, folder, tmp_path):
    for photo, permissions in zip(sorted(folder.iterdir()), (0o664, 0o640), strict=True):
        photo.chmod(permissions)
    page = tmp_path / "page.html"
    assert deblur("--report", page).code == 0
    assert page.stat().st_mode & 0o777 == 0o640
