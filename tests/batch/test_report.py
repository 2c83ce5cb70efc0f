from __future__ import annotations

import errno
import os
import re
from pathlib import Path

import numpy as np
import pytest

from deshake.batch.plan import Job
from deshake.batch.report import Report, ReportPlace
from deshake.batch.task import Result
from deshake.errors import OutputError
from deshake.pictures.report_pictures import Encoded, ReportPictures

IMPROVED = {"verdict": "improved", "extent_px": 12.3, "confidence": 0.8}
LEFT = {"verdict": "left", "reason": "the photo looks sharp", "extent_px": 0, "confidence": 0.1}


def drawn(text=b"some"):
    return ReportPictures(
        (30, 40),
        Encoded(b"1" + text, 40, 30),
        Encoded(b"2" + text, 40, 30),
        Encoded(b"3" + text, 40, 30),
        Encoded(b"4" + text, 40, 30),
        (0, 0),
        (0, 0, 40, 30),
        Encoded(b"5" + text, 9, 9, "png"),
    )


@pytest.fixture
def jobs(tmp_path):
    return [
        Job(tmp_path / f"{name}.jpg", tmp_path / "out" / f"{name}.deshaken.jpg")
        for name in ("one", "two", "three")
    ]


def names(folder):
    return [path.name for path in folder.iterdir()]


def report(place, jobs):
    return Report(place, jobs, "deshake fix all", lambda job: f"deshake fix {job.source.name}")


def made(place, jobs, results):
    with report(place, jobs) as under_way:
        for result in results:
            under_way.add(result)
        return under_way.write()


def test_a_folder_has_its_page_under_a_name(tmp_path):
    assert ReportPlace(tmp_path / "look.html").page == tmp_path / "look.html"
    assert ReportPlace(tmp_path / "look").page == tmp_path / "look" / "report.html"
    assert ReportPlace(tmp_path).page == tmp_path / "report.html"
    (tmp_path / "odd.html").mkdir()
    assert ReportPlace(tmp_path / "odd.html").page == tmp_path / "odd.html" / "report.html"


def test_photos_stand_in_the_order_of_the_plan(tmp_path, jobs):
    one, two, three = jobs
    results = [
        Result(three, "failed", 0.5, error=f"{three.source}: is no photo", hint="try another"),
        Result(one, "done", 2.0, IMPROVED, ("mind",), pictures=drawn()),
        Result(two, "done", 1.0, LEFT, pictures=drawn()),
    ]
    text = made(ReportPlace(tmp_path / "a.html"), jobs, results).read_text("utf-8")
    places = [text.index(f'<article id="p{number}"') for number in (1, 2, 3)]
    assert places == sorted(places)
    assert "1 improved, 1 left as it is, 1 failed" in text
    for words in (
        "shake of 12 px, fairly confident",
        "<dd>mind</dd>",
        "the photo looks sharp",
        ">Failed</span>: is no photo<",
        '<h2 id="h1">one.jpg</h2>',
        "What to try: try another",
        "deshake fix two.jpg",
        'href="out/one.deshaken.jpg"',
    ):
        assert words in text
    assert names(tmp_path) == ["a.html"]


def test_skipped_photos_and_photos_that_were_not_begun(tmp_path, jobs):
    text = made(ReportPlace(tmp_path / "a.html"), jobs, [Result(jobs[1], "skipped")]).read_text()
    assert "its result exists already" in text
    assert "one.jpg" not in text


def test_photos_are_named_from_the_folder_that_all_are_in(tmp_path):
    place = ReportPlace(tmp_path / "a.html")
    for photos, labels in (
        (["in/a.jpg"], ["a.jpg"]),
        (["in/a.jpg", "in/b.jpg"], ["a.jpg", "b.jpg"]),
        (["in/a.jpg", "in/below/a.jpg"], ["a.jpg", "below/a.jpg"]),
        (["a.jpg", "in/a.jpg"], ["a.jpg", "in/a.jpg"]),
        (["/one/a.jpg", "a.jpg"], ["/one/a.jpg", "a.jpg"]),
    ):
        jobs = [Job(Path(name), tmp_path / str(n)) for n, name in enumerate(photos)]
        page = made(place, jobs, [Result(job, "done", 1, IMPROVED) for job in jobs])
        assert re.findall(r"<h2[^>]*>(.*)</h2>", page.read_text("utf-8")) == labels
        page.unlink()


def test_addresses_are_quoted(tmp_path):
    job = Job(tmp_path / "a", tmp_path / "x\" y#'?<%41:é.jpg")
    text = made(ReportPlace(tmp_path / "a.html"), [job], [Result(job, "done", 1, IMPROVED)])
    assert 'href="x%22%20y%23%27%3F%3C%2541%3A%C3%A9.jpg"' in text.read_text("utf-8")


def test_pictures_beside_the_page(tmp_path, jobs):
    place = ReportPlace(tmp_path / "a.html", beside=True)
    made(place, jobs, [Result(jobs[0], "done", 1, IMPROVED, pictures=drawn())])
    first = sorted(names(tmp_path / "a-pictures"))
    assert len(first) == 5
    text = (tmp_path / "a.html").read_text("utf-8")
    assert "data:image" not in text
    assert all(f"a-pictures/{name}" in text for name in first)
    # The same pictures again replace nothing; other pictures replace the first.
    again = ReportPlace(tmp_path / "a.html", beside=True, overwrite=True)
    made(again, jobs, [Result(jobs[0], "done", 1, IMPROVED, pictures=drawn())])
    assert sorted(names(tmp_path / "a-pictures")) == first
    (tmp_path / "a-pictures" / "mine.jpg").write_text("mine")
    made(again, jobs, [Result(jobs[0], "done", 1, IMPROVED, pictures=drawn(b"other"))])
    later = names(tmp_path / "a-pictures")
    assert len(later) == 6
    assert set(later) & set(first) == set()
    assert "mine.jpg" in later


@pytest.mark.parametrize("beside", [False, True])
def test_nothing_is_left_of_a_report_that_is_not_written(tmp_path, jobs, beside):
    under_way = report(ReportPlace(tmp_path / "a.html", beside=beside), jobs)
    with under_way:
        under_way.add(Result(jobs[0], "done", 1, IMPROVED, pictures=drawn()))
    assert names(tmp_path) == []


def test_a_page_that_another_made_meanwhile_stays(tmp_path, jobs):
    under_way = report(ReportPlace(tmp_path / "a.html", beside=True), jobs)
    with under_way:
        under_way.add(Result(jobs[0], "done", 1, IMPROVED, pictures=drawn()))
        (tmp_path / "a.html").write_text("another's")
        with pytest.raises(OutputError, match="exists already"):
            under_way.write()
    assert (tmp_path / "a.html").read_text() == "another's"
    assert names(tmp_path) == ["a.html"]


def test_a_full_disk_is_an_error_of_the_report(tmp_path, jobs):
    class Full:
        def tell(self):
            return 0

        def write(self, _data):
            raise OSError(errno.ENOSPC, "No space left on device")

        def close(self):
            pass

    with report(ReportPlace(tmp_path / "a.html"), jobs) as under_way:
        under_way._waiting.close()
        under_way._waiting = Full()
        with pytest.raises(OutputError, match="no space left") as caught:
            under_way.add(Result(jobs[0], "done", 1, IMPROVED, pictures=drawn()))
    assert "--report" in caught.value.hint


def test_what_prevents_a_report_is_found_before_the_work(tmp_path, jobs):
    page = tmp_path / "a.html"
    page.write_text("mine")
    with pytest.raises(OutputError, match="exists already") as caught:
        ReportPlace(page).check(jobs)
    assert caught.value.hint == (
        "choose another place with --report, or allow replacing it with --overwrite"
    )
    ReportPlace(page, overwrite=True).check(jobs)
    with pytest.raises(OutputError, match="no such folder") as caught:
        ReportPlace(tmp_path / "no" / "a.html").check(jobs)
    assert caught.value.hint == "choose another place with --report"
    (tmp_path / "b-pictures").write_text("mine")
    with pytest.raises(OutputError, match="is not a folder"):
        ReportPlace(tmp_path / "b.html", beside=True).check(jobs)
    with pytest.raises(OutputError, match="is not a folder"):
        ReportPlace(page / "c.html").check(jobs)


def test_no_photo_and_no_result_is_replaced(tmp_path):
    photo = tmp_path / "photo.html"
    photo.write_text("a photo")
    linked = tmp_path / "linked.html"
    os.link(photo, linked)
    inputs = [Job(photo, tmp_path / "result.html", {"kernel": tmp_path / "k.html"})]
    for name in ("photo.html", "linked.html", "result.html", "k.html"):
        with pytest.raises(OutputError, match="is a photo or an output of this run"):
            ReportPlace(tmp_path / name, overwrite=True).check(inputs)
    assert photo.read_text() == "a photo"


def test_the_folder_is_made_except_in_a_dry_run(tmp_path, jobs):
    ReportPlace(tmp_path / "new").check(jobs, dry=True)
    assert names(tmp_path) == []
    ReportPlace(tmp_path / "new").check(jobs)
    assert (tmp_path / "new").is_dir()


def test_hundreds_of_photos_wait_on_the_disk(tmp_path):
    jobs = [Job(tmp_path / f"{n}.jpg", tmp_path / f"{n}.deshaken.jpg") for n in range(300)]
    noise = np.random.default_rng(3).bytes(25_000)
    with report(ReportPlace(tmp_path / "a.html"), jobs) as under_way:
        for job in jobs:
            under_way.add(Result(job, "done", 1, IMPROVED, pictures=drawn(noise)))
        assert under_way._waiting.tell() > 300 * 5 * 25_000
        page = under_way.write()
    assert 50e6 < page.stat().st_size < 60e6
