from __future__ import annotations

from pathlib import Path

import pytest

from deshake.batch.folders import find_photos, natural_order
from deshake.errors import PhotoError


@pytest.fixture(autouse=True)
def _files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("b.PNG", "in/z.jpg", "in/y.tif", "in/a.txt", "in/d/q.jpg", "in/.h/x.jpg"):
        path = Path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()


def listed(*names, **options):
    return [f.path.as_posix() for f in find_photos([Path(name) for name in names], **options)]


def test_folders_are_searched_by_name_and_not_below():
    assert listed("b.PNG", "in", "missing.jpg") == [
        "b.PNG",
        "in/y.tif",
        "in/z.jpg",
        "missing.jpg",
    ]


def test_folders_in_folders_are_searched_if_asked():
    photos = find_photos([Path("in")], recursive=True)
    assert [photo.path.as_posix() for photo in photos] == ["in/y.tif", "in/z.jpg", "in/d/q.jpg"]
    assert [photo.below for photo in photos] == [Path(), Path(), Path("d")]


def test_results_hidden_files_and_folders_are_no_photos():
    for name in ("in/z.deshaken.jpg", "in/z.deshaken.compare.png", "in/.x.jpg"):
        Path(name).touch()
    Path("in/folder.jpg").mkdir()
    assert listed("in", recursive=True) == ["in/y.tif", "in/z.jpg", "in/d/q.jpg"]


def test_numbers_count_by_their_value():
    names = ["img_10.jpg", "IMG_2.jpg", "img_02.jpg", "IMG_1.jpg", "img.jpg", "10.jpg", "9.jpg"]
    for name in names:
        Path("in/d", name).touch()
    order = ["9.jpg", "10.jpg", "img.jpg", "IMG_1.jpg", "IMG_2.jpg", "img_02.jpg", "img_10.jpg"]
    assert listed("in/d") == [f"in/d/{name}" for name in [*order, "q.jpg"]]
    assert natural_order("IMG_٣") != natural_order("img_3")  # other digits are letters


def test_links_that_go_round_are_followed_once():
    Path("in/d/up").symlink_to("..")
    Path("in/same").symlink_to("d")
    Path("in/link.jpg").symlink_to("z.jpg")
    Path("in/gone.jpg").symlink_to("nowhere")
    photos = listed("in", recursive=True)
    assert photos == ["in/link.jpg", "in/y.tif", "in/z.jpg", "in/d/q.jpg"]


def test_folders_of_results_are_left_out_under_any_name():
    Path("in/other").symlink_to("d")
    assert listed("in", recursive=True, without=[Path("in/other")]) == ["in/y.tif", "in/z.jpg"]


def test_a_folder_without_photos_is_an_error():
    Path("in/d/q.jpg").unlink()
    with pytest.raises(PhotoError, match="no photos in this folder") as caught:
        listed("b.PNG", "in/d")
    assert "-r" in caught.value.hint
    with pytest.raises(PhotoError, match="no photos"):
        listed("in/d", recursive=True)
