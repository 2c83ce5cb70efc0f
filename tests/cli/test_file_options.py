from __future__ import annotations

import html
import io
import json
import os
import shlex
import shutil

import numpy as np
import pytest
import tifffile
from PIL import Image

from deshake.formats.photo import read_photo
from deshake.metadata.provenance import read_provenance
from deshake.stages.reducing import reduced

FAST = ("--blur-size", 3, "--uniform", "--focal-35mm", 40, "--iterations", 2)
TIME = 1_500_000_000_123_456_789


@pytest.fixture
def deblur(deshake, pan):
    """Deblur a photo with few iterations."""

    def run(photo, *words):
        return deshake("deblur", photo, pan, "--iterations", 1, *words)

    return run


@pytest.fixture
def deblur_all(deshake, pan):
    """Deblur photos of folders with one kernel, one after another."""

    def run(*words):
        return deshake("deblur", *words, "--kernel", pan, "--iterations", 1, "-j", 1)

    return run


@pytest.fixture
def tree(sharp_photo, tmp_path):
    """A folder with the photos one.jpg, two.png and below/one.jpg."""
    folder = tmp_path / "in"
    (folder / "below").mkdir(parents=True)
    one = sharp_photo("one.jpg").rename(folder / "one.jpg")
    shutil.copy(one, folder / "below" / "one.jpg")
    sharp_photo("two.png").rename(folder / "two.png")
    return folder


def tables(path):
    with Image.open(path) as picture:
        return picture.quantization


def tables_of(quality):
    stream = io.BytesIO()
    Image.new("RGB", (8, 8)).save(stream, "JPEG", quality=quality)
    return tables(stream)


def commands_of(page):
    """Return the commands for the photos of a report."""
    texts = html.unescape(page.read_text("utf-8")).split(">")
    lines = [text.split("<")[0] for text in texts if text.startswith("deshake deblur")]
    return [line for line in lines if "--report" not in line]


def files(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.*"))


# --jpeg-quality


def test_a_jpeg_has_the_tables_of_the_photo_or_of_the_quality(deblur, shaken, tmp_path):
    photo = shaken("a.jpg")
    for name, words in {"as-it-was": (), "20": ("--jpeg-quality", 20)}.items():
        assert deblur(photo, *words, "-o", tmp_path / f"{name}.jpg").code == 0
    assert tables(tmp_path / "as-it-was.jpg") == tables(photo) == tables_of(92)
    assert tables(tmp_path / "20.jpg") == tables_of(20)
    assert (tmp_path / "20.jpg").stat().st_size < (tmp_path / "as-it-was.jpg").stat().st_size
    assert read_provenance(tmp_path / "20.jpg")["options"]["jpeg_quality"] == 20
    assert "jpeg_quality" not in read_provenance(tmp_path / "as-it-was.jpg")["options"]


def test_the_quality_of_what_was_no_jpeg_is_95_by_default(deblur, shaken, tmp_path):
    photo = shaken("a.png", 16)
    assert deblur(photo, "-o", tmp_path / "95.jpg").code == 0
    assert deblur(photo, "-o", tmp_path / "30.jpg", "--jpeg-quality", 30).code == 0
    assert tables(tmp_path / "95.jpg") == tables_of(95)
    assert tables(tmp_path / "30.jpg") == tables_of(30)


def test_a_jpeg_that_stays_as_it_is_takes_the_quality_too(deshake, sharp_photo, tmp_path):
    photo = sharp_photo("a.jpg")
    outcome = deshake("fix", photo, *FAST, "--jpeg-quality", 30)
    assert "left as it is" in outcome.err
    assert tables(tmp_path / "a.deshaken.jpg") == tables_of(30)


@pytest.mark.parametrize("quality", ["0", "101", "-1", "high", "80%", "7.5"])
def test_a_quality_is_a_whole_number_up_to_100(deblur, shaken, quality):
    outcome = deblur(shaken("a.jpg"), "--jpeg-quality", quality)
    assert outcome.code == 2
    assert "--jpeg-quality" in outcome.err


@pytest.mark.parametrize(
    "words", [(), ("-o", "x.png"), ("--format", "webp"), ("-o", "{stem}-x.tif")]
)
def test_a_quality_without_a_jpeg_is_wrong_usage(
    deblur, shaken, contents, tmp_path, monkeypatch, *, words
):
    monkeypatch.chdir(tmp_path)
    photo = shaken("a.png")
    before = contents(tmp_path)
    outcome = deblur(photo, "--jpeg-quality", 80, *words)
    assert outcome.code == 2
    assert "--jpeg-quality is for JPEGs, and no result is one: add --format jpeg" in outcome.err
    assert contents(tmp_path) == before


def test_of_many_photos_the_jpegs_take_the_quality(deblur_all, tree, tmp_path):
    out = tmp_path / "out"
    outcome = deblur_all(tree, "-o", out, "--jpeg-quality", 15)
    assert outcome.code == 0, outcome.err
    assert tables(out / "one.deshaken.jpg") == tables_of(15)
    assert "jpeg_quality" not in read_provenance(out / "two.deshaken.png")["options"]
    again = deblur_all(tree, "-o", out, "--jpeg-quality", 25, "--skip-existing")
    assert "one.deshaken.jpg exists already, but was made with other options" in again.err
    assert "(jpeg_quality 15, now 25)" in again.err
    assert "two.deshaken.png exists" not in again.err


# --format


@pytest.mark.parametrize(
    ("name", "depth", "form", "result", "mode"),
    [
        ("a.jpg", 8, "png", "a.deshaken.png", "RGB"),
        ("a.JPG", 8, "jpeg", "a.deshaken.JPG", "RGB"),
        ("a.png", 16, "jpg", "a.deshaken.jpg", "RGB"),
        ("a.png", 8, "TIFF", "a.deshaken.tif", "RGB"),
        ("a.png", 8, "tif", "a.deshaken.tif", "RGB"),
        ("a.png", 8, "webp", "a.deshaken.webp", "RGB"),
        ("a.png", 8, "avif", "a.deshaken.avif", "RGB"),
        ("a.png", 8, "jp2", "a.deshaken.jp2", "RGB"),
    ],
)
def test_the_format_decides_the_ending_and_the_file(
    deblur, shaken, tmp_path, *, name, depth, form, result, mode
):
    outcome = deblur(shaken(name, depth), "--format", form)
    assert outcome.code == 0, outcome.err
    with Image.open(tmp_path / result) as picture:
        kind = {"jpg": "jpeg", "tif": "tiff", "jp2": "jpeg2000"}.get(form, form).upper()
        assert (picture.format, picture.mode, picture.size) == (kind, mode, (100, 80))


def test_the_format_gives_the_bytes_of_the_ending(deblur, shaken, tmp_path):
    photo = shaken("a.jpg")
    assert deblur(photo, "--format", "png").code == 0
    assert deblur(photo, "-o", tmp_path / "b.png").code == 0
    assert (tmp_path / "a.deshaken.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert deblur(photo, "-o", tmp_path / "c.png", "--format", "png").code == 0


def test_a_photo_whose_name_lies_gets_the_format(deblur, shaken, tmp_path):
    photo = shaken("a.png").rename(tmp_path / "a.jpg")
    assert deblur(photo, "--format", "jpeg").code == 0
    with Image.open(tmp_path / "a.deshaken.jpg") as picture:
        assert picture.format == "JPEG"


@pytest.mark.parametrize(
    ("form", "output", "says"),
    [
        ("jpeg", "x.png", "--format does not go with -o x.png"),
        ("tiff", "x", "--format does not go with -o x"),
        ("png", "{stem}.jpg", "it ends in .jpg, which is another format than --format names"),
        ("gif", None, "'gif' is not one of 'jpeg', 'png', 'tiff'"),
    ],
)
def test_a_format_that_does_not_go_with_the_name_is_wrong_usage(
    deblur, shaken, tmp_path, monkeypatch, *, form, output, says
):
    monkeypatch.chdir(tmp_path)
    photo = shaken("a.jpg")
    outcome = deblur(photo, "--format", form, *(("-o", output) if output else ()))
    assert outcome.code == 2
    assert says in outcome.err
    assert list(tmp_path.iterdir()) == [photo]


def test_transparency_and_jpeg_are_refused(deblur, tmp_path):
    codes = np.random.default_rng(0).integers(0, 255, (80, 100, 4)).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "a.png")
    outcome = deblur(tmp_path / "a.png", "--format", "jpeg")
    assert outcome.code == 1
    assert "a JPEG cannot hold transparency" in outcome.err


# Templates


def test_a_template_names_the_results_of_a_tree(deshake, tree, tmp_path):
    out, kernels, page = tmp_path / "sharp", tmp_path / "k", tmp_path / "r.html"
    words = (tree, "-r", *FAST, "-o", f"{out}/{{folder}}/{{stem}}_deshaken.{{ext}}", "--compare")
    dry = deshake("fix", *words, "--dry-run")
    assert dry.code == 0
    assert f"do {tree / 'below' / 'one.jpg'} -> {out / 'below' / 'one_deshaken.jpg'}" in dry.out
    assert not out.exists()
    outcome = deshake("fix", *words, "--keep-kernels", kernels, "--report", page)
    assert outcome.code == 0, outcome.err
    results = {"below/one_deshaken.jpg", "one_deshaken.jpg", "two_deshaken.png"}
    sheets = {"below/one_deshaken.compare.png", "one_deshaken.compare.png"}
    assert set(files(out)) == results | sheets | {"two_deshaken.compare.png"}
    assert files(kernels) == ["below/one.kernel.npz", "one.kernel.npz", "two.kernel.npz"]
    assert f"{out / 'below' / 'one_deshaken.jpg'}" in page.read_text("utf-8")
    refused = deshake("fix", *words, "--dry-run")
    assert refused.code == 1
    assert refused.err.count("exists already") == 3
    (out / "two_deshaken.png").unlink()
    again = deshake("fix", *words, "--skip-existing", "--json")
    assert sorted(json.loads(line)["status"] for line in again.out.splitlines()) == [
        "done",
        "skipped",
        "skipped",
    ]
    assert (out / "two_deshaken.png").exists()


def test_photos_that_would_collide_are_refused_before_any_work(deshake, tree, contents, tmp_path):
    before = contents(tmp_path)
    outcome = deshake("fix", tree, "-r", *FAST, "-o", tmp_path / "out" / "{stem}.{ext}")
    assert outcome.code == 2
    assert f"would both be written to {tmp_path / 'out' / 'one.jpg'}" in outcome.err
    assert "add more fields to the name" in outcome.err
    assert contents(tmp_path) == before
    assert not (tmp_path / "out").exists()


def test_parents_distinguish_photos_of_one_name(deshake, tree, tmp_path):
    photos = (tree / "one.jpg", tree / "below" / "one.jpg")
    outcome = deshake("fix", *photos, "-o", tmp_path / "{parent}-{stem}.{ext}", "--dry-run")
    assert [line.rpartition("/")[2] for line in outcome.out.splitlines()] == [
        "in-one.jpg",
        "below-one.jpg",
    ]


def test_earlier_results_among_the_photos_are_passed_over(deblur_all, tree):
    words = (tree, "-r", "-o", tree / "{folder}" / "{stem}_x.{ext}")
    assert deblur_all(*words).code == 0
    names = files(tree)
    assert names[:4] == ["below/one.jpg", "below/one_x.jpg", "one.jpg", "one_x.jpg"]
    assert names[4:] == ["two.png", "two_x.png"]
    for more, word in (("--skip-existing", "skip"), ("--overwrite", "do")):
        again = deblur_all(*words, more, "--dry-run")
        assert [line.split()[0] for line in again.out.splitlines()] == [word] * 3


@pytest.mark.parametrize("more", [(), ("--overwrite",), ("--skip-existing",)])
def test_no_photo_is_replaced_by_the_result_of_another(deshake, tree, contents, tmp_path, *, more):
    other = shutil.copy(tree / "one.jpg", tree / "one_x.jpg")
    before = contents(tmp_path)
    words = (tree, "-o", tree / "{stem}_x.{ext}", *more)
    outcome = deshake("fix", *words, "--dry-run")
    assert outcome.code == 1
    assert f"error: {other}: the output is the input itself" in outcome.err
    assert contents(tmp_path) == before


@pytest.mark.parametrize("more", [(), ("--overwrite",), ("--skip-existing",)])
def test_a_result_never_is_its_photo(deblur, shaken, tmp_path, contents, *, more):
    photo = shaken("a.jpg")
    before = contents(tmp_path)
    outcome = deblur(photo, "-o", tmp_path / "{stem}.{ext}", *more)
    assert outcome.code == 1
    assert "the output is the input itself, which deshake never touches" in outcome.err
    assert contents(tmp_path) == before


def test_no_name_leads_out_of_the_folder(deshake, shaken, tmp_path):
    (tmp_path / "in").mkdir()
    odd, good = tmp_path / "in" / "...jpg", tmp_path / "in" / "good.jpg"
    shutil.copy(shaken("a.jpg").rename(good), odd)
    words = ("-o", tmp_path / "out" / "{stem}" / "x.{ext}")
    outcome = deshake("fix", odd, *words)
    assert outcome.code == 1
    assert f"error: {odd}: its name leads out of {tmp_path / 'out'}" in outcome.err
    assert files(tmp_path) == ["in/...jpg", "in/good.jpg"]
    dry = deshake("fix", odd, good, *words, "--dry-run")
    assert dry.code == 1
    assert dry.out == f"do {good} -> {tmp_path / 'out' / 'good' / 'x.jpg'}\n"


@pytest.mark.parametrize(
    ("template", "says"),
    [
        ("{stem", "a brace stands alone"),
        ("{name}.jpg", "{name} is no field; there are {folder}, {parent}, {stem}, {ext}"),
        ("{stem}", "it has to end in .{ext}"),
        ("{folder}/../{stem}.jpg", "there may be no .. behind a field"),
    ],
)
@pytest.mark.parametrize("command", ["fix", "deblur"])
def test_a_wrong_template_is_wrong_usage(deshake, shaken, pan, *, command, template, says):
    kernel = (pan,) if command == "deblur" else ()
    outcome = deshake(command, shaken("a.jpg"), *kernel, "-o", template)
    assert outcome.code == 2
    assert f"error: -o {template}: {says}" in outcome.err


def test_doubled_braces_are_braces_also_in_the_command_of_a_report(
    deshake, deblur, shaken, tmp_path
):
    photo, page = shaken("a{1}.jpg"), tmp_path / "r.html"
    out = ("-o", f"{tmp_path}/o{{{{2}}}}.jpg")
    assert deblur(photo, *out, "--report", page, "--jpeg-quality", 70, "--max-size", 50).code == 0
    made = tmp_path / "o{2}.jpg"
    bytes_then = made.read_bytes()
    made.unlink()
    [command] = commands_of(page)
    assert deshake(*shlex.split(command)[1:]).code == 0, command
    assert made.read_bytes() == bytes_then


def test_the_commands_of_a_report_are_right_usage(deblur_all, deshake, tree, tmp_path):
    page, config = tmp_path / "r.html", tmp_path / "c.toml"
    words = (tree, "-o", tmp_path / "out", "--report", page, "--jpeg-quality", 15)
    assert deblur_all(*words).code == 0
    commands = commands_of(page)
    assert ["--jpeg-quality" in command for command in commands] == [True, False]
    for command in commands:
        assert deshake(*shlex.split(command)[1:], "--overwrite", "--dry-run").code == 0, command
    config.write_text('[deblur]\nformat = "webp"\n')
    page.unlink()
    words = ("deblur", tree / "one.jpg", "--kernel", tmp_path / "none", "-o", tmp_path / "b.png")
    assert deshake("--config", config, *words, "--report", page).code == 1
    assert ["--format" in command for command in commands_of(page)] == [False]


# --preserve


def test_preserve_keeps_the_time_of_each_photo(deshake, sharp_photo, tmp_path):
    photo, kernels = sharp_photo("a.png"), tmp_path / "k"
    os.utime(photo, ns=(TIME, TIME))
    words = (*FAST, "--preserve", "--compare", "--keep-kernels", kernels)
    assert deshake("fix", photo, *words).code == 0
    assert (tmp_path / "a.deshaken.png").stat().st_mtime_ns == TIME
    others = (tmp_path / "a.deshaken.compare.png", kernels / "a.kernel.npz")
    assert all(path.stat().st_mtime_ns > TIME for path in others)


def test_without_preserve_the_time_is_that_of_the_run(deblur, shaken, tmp_path):
    photo = shaken("a.jpg")
    os.utime(photo, ns=(TIME, TIME))
    photo.chmod(0o640)
    assert deblur(photo, "-o", tmp_path / "now.jpg").code == 0
    assert deblur(photo, "-o", tmp_path / "then.jpg", "--preserve").code == 0
    assert (tmp_path / "now.jpg").stat().st_mtime_ns > TIME
    assert (tmp_path / "then.jpg").stat().st_mtime_ns == TIME
    assert (tmp_path / "then.jpg").stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "now.jpg").read_bytes() == (tmp_path / "then.jpg").read_bytes()


def test_preserve_takes_no_value(deblur, shaken):
    assert deblur(shaken("a.jpg"), "--preserve=mtime").code == 2


# --max-size


@pytest.fixture
def photo_of(shaken, make_dng, tmp_path):
    """Save a photo of 100 x 80 of some kind."""

    def save(kind):
        if kind == "dng":
            light = np.random.default_rng(1).random((10, 13, 3), np.float32).repeat(8, 0)
            light = light.repeat(8, 1)[:, :100] * 1.3  # beyond white
            path = tmp_path / "a.dng"
            path.write_bytes(make_dng(np.clip(light, 0, 1.2)))
            return path
        if kind == "float":
            light = read_photo(shaken("b.png", 16)).pixels * 2 - 0.1
            tifffile.imwrite(tmp_path / "a.tif", light, photometric="rgb")
            return tmp_path / "a.tif"
        name, depth = {"png16": ("a.png", 16), "tif16": ("c.tif", 16), "png": ("d.png", 8)}[kind]
        return shaken(name, depth)

    return save


@pytest.mark.parametrize("kind", ["png", "png16", "tif16", "float", "dng"])
def test_the_result_is_the_whole_one_reduced_in_linear_light(deblur, photo_of, tmp_path, *, kind):
    photo = photo_of(kind)
    ending = ".tif" if kind == "dng" else photo.suffix
    whole, small = tmp_path / f"whole{ending}", tmp_path / f"small{ending}"
    assert deblur(photo, "-o", whole).code == 0
    outcome = deblur(photo, "-o", small, "--max-size", 40)
    assert outcome.code == 0, outcome.err
    wanted, got = reduced(read_photo(whole), 40), read_photo(small)
    assert got.shape == (32, 40)
    assert (got.encoding.depth, got.encoding.format) == (
        wanted.encoding.depth,
        wanted.encoding.format,
    )
    assert got.metadata.icc == wanted.metadata.icc
    assert got.pixels == pytest.approx(wanted.pixels, abs=0.006 if kind == "png" else 4e-5)
    assert read_provenance(small)["options"]["max_size"] == 40


def test_a_small_photo_is_not_enlarged(deblur, shaken, tmp_path):
    photo = shaken("a.png")
    for size in (100, 5000):
        assert deblur(photo, "-o", tmp_path / f"{size}.png", "--max-size", size).code == 0
    assert deblur(photo, "-o", tmp_path / "plain.png").code == 0
    plain = np.asarray(Image.open(tmp_path / "plain.png"))
    for size in (100, 5000):
        assert np.array_equal(np.asarray(Image.open(tmp_path / f"{size}.png")), plain)


def test_the_metadata_of_a_smaller_result_are_true(deshake, deblur, make_exif, shaken, tmp_path):
    photo, small = shaken("a.jpg"), tmp_path / "small.jpg"
    below = {0xA002: 100, 0xA003: 80, 0xA20E: 20.0, 0xA20F: 20.0, 0xA210: 3, 0x9214: (60, 40)}
    xmp = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf='
    xmp += b'"http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description '
    xmp += b'xmlns:exif="http://ns.adobe.com/exif/1.0/" exif:PixelXDimension="100" '
    xmp += b'exif:FocalPlaneXResolution="20/1"/></rdf:RDF></x:xmpmeta>'
    with Image.open(photo) as picture:
        picture.save(photo, exif=b"Exif\0\0" + make_exif(below=below), xmp=xmp, dpi=(300, 300))
    assert deblur(photo, "-o", small, "--max-size", 50).code == 0
    with Image.open(small) as picture:
        tags = picture.getexif().get_ifd(0x8769)
        assert picture.size == (50, 40) == (tags[0xA002], tags[0xA003])
        assert (tags[0xA20E], tags[0xA20F]) == (10, 10)
        assert tuple(tags[0x9214]) == (30, 20)
        assert picture.info["dpi"] == (300, 300)
        assert b'PixelXDimension="50"' in picture.info["xmp"]
        assert b'FocalPlaneXResolution="10000/1000"' in picture.info["xmp"]
    large, little = (
        json.loads(deshake("calibrate", path, "-o", tmp_path / f"{path.stem}.npz", "--json").out)
        for path in (photo, small)
    )
    assert little["focal_px"] == pytest.approx(large["focal_px"] / 2, rel=1e-3)


def test_what_the_format_can_hold_is_checked_before_the_work(deblur, photo_of, tmp_path):
    """JPEG 2000 needs 32 pixels a side: the reduced photo counts."""
    photo, out = photo_of("png"), ("-o", tmp_path / "a.jp2", "-v")
    outcome = deblur(photo, *out, "--max-size", 30)
    assert outcome.code == 1
    assert "32 pixels" in outcome.err
    assert "deblurred in" not in outcome.err
    assert not (tmp_path / "a.jp2").exists()
    outcome = deblur(photo, *out, "--max-size", 45)
    assert outcome.code == 0
    assert "deblurred in" in outcome.err


def test_fix_gives_the_bytes_of_its_stages(deshake, shaken, tmp_path):
    photo, kernels = shaken("a.jpg", large=True, size=(150, 120)), tmp_path / "k"
    words = ("--max-size", 90, "--jpeg-quality", 60, "--iterations", 2)
    estimate = ("--blur-size", 9, "--uniform", "--region", "20,10,110,100")
    fixed = (*estimate, "--keep-kernels", kernels, *words)
    assert deshake("fix", photo, *fixed, "-o", tmp_path / "fixed.jpg").code == 0
    stages = (kernels / "a.kernel.npz", *words, "-o", tmp_path / "stages.jpg")
    assert deshake("deblur", photo, *stages).code == 0
    assert (tmp_path / "fixed.jpg").read_bytes() == (tmp_path / "stages.jpg").read_bytes()
    with Image.open(tmp_path / "fixed.jpg") as picture:
        assert picture.size == (90, 72)


@pytest.mark.parametrize("size", ["0", "-5", "2048x1536", "2k", "1.5"])
def test_a_size_is_a_whole_number_of_pixels(deblur, shaken, size):
    outcome = deblur(shaken("a.jpg"), "--max-size", size)
    assert outcome.code == 2
    assert "--max-size" in outcome.err


# Configuration


def test_the_configuration_file_and_the_environment_have_all_of_them(
    deshake, shaken, pan, tmp_path, monkeypatch
):
    photo, config = shaken("a.png"), tmp_path / "c.toml"
    os.utime(photo, ns=(TIME, TIME))
    config.write_text(
        '[deblur]\nformat = "jpg"\njpeg-quality = 35\nmax-size = 40\npreserve = true\n'
        f"output = '{tmp_path}/{{stem}}-small.{{ext}}'\n"
    )
    assert deshake("--config", config, "deblur", photo, pan).code == 0
    result = tmp_path / "a-small.jpg"
    assert tables(result) == tables_of(35)
    assert result.stat().st_mtime_ns == TIME
    with Image.open(result) as picture:
        assert picture.size == (40, 32)
    assert deshake("--config", config, "deblur", photo, pan, "-o", tmp_path / "b.png").code == 0
    with Image.open(tmp_path / "b.png") as picture:  # the command line has priority
        assert (picture.format, picture.size) == ("PNG", (40, 32))
    monkeypatch.setenv("DESHAKE_DEBLUR_FORMAT", "webp")
    assert deshake("deblur", photo, pan, "-o", tmp_path).code == 0
    assert (tmp_path / "a.deshaken.webp").exists()
    for line in ("format = 3", "jpeg-quality = 4.5", 'max-size = "large"', "preserve = 1"):
        config.write_text(f"[deblur]\n{line}\n")
        assert deshake("--config", config, "deblur", photo, pan).code == 2, line
