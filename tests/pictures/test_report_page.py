from __future__ import annotations

import base64
import re
from html.parser import HTMLParser

import pytest

from deshake.pictures.report_page import (
    Entry,
    article,
    embedded,
    page_head,
    page_tail,
    printable,
)
from deshake.pictures.report_pictures import Encoded, ReportPictures

VOID = {"meta", "img", "input", "br", "link", "hr"}
HOSTILE = "<script>alert('x')</script> \"onload=\"y & \u202egnp.\x1b[31m \udc80.jpg"


class Page(HTMLParser):
    """Reads a page, and fails unless every element that is opened is closed, in order."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.words = [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), f"an attribute of {tag} stands twice"
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] not in {"script", "style"}:
            self.words.append(data)

    def all(self, tag, **attributes):
        return [
            given
            for name, given in self.elements
            if name == tag and all(given.get(key) == value for key, value in attributes.items())
        ]

    @property
    def text(self):
        return " ".join(self.words)


def pictures(*, left=False):
    def one(text):
        return Encoded(text, 40, 30)

    return ReportPictures(
        (300, 400),
        one(b"before"),
        None if left else one(b"after"),
        one(b"part"),
        None if left else one(b"part after"),
        (100, 90),
        (10, 5, 20, 15),
        None if left else Encoded(b"kernel", 24, 24, "png"),
    )


def entry(number=1, **more):
    values = {
        "name": f"photo {number}.jpg",
        "verdict": "improved",
        "why": "shake of 23 px, confident",
        "command": "deshake fix photo.jpg",
        "seconds": 2.04,
        "result": ("photo.deshaken.jpg", "photo.deshaken.jpg"),
        "extent_px": 23.4,
        "confidence": 0.95,
        "confidence_words": "confident",
    } | more
    return Entry(number, **values)


def whole(entries, shown=None, **more):
    shown = shown or {}
    body = [article(each, shown.get(each.number), **more) for each in entries]
    return page_head(entries, "deshake fix photos/") + "".join(body) + page_tail()


def test_a_photo_is_shown_before_and_after():
    page = Page(whole([entry()], {1: pictures()}))
    [slider] = page.all("input", type="range")
    assert slider["aria-label"] == "Before and after: photo 1.jpg"
    after, before, kernel = page.all("img")
    assert before["src"] == "data:image/jpeg;base64," + base64.b64encode(b"before").decode()
    assert after["src"].endswith(base64.b64encode(b"after").decode())
    assert kernel["src"].startswith("data:image/png;base64,")
    assert all(image["alt"] for image in (before, after, kernel))
    [photo] = page.all("article")
    assert base64.b64encode(b"part").decode() in photo["style"]
    assert base64.b64encode(b"part after").decode() in photo["style"]
    crops = page.all("div", role="img")
    assert [crop["style"] for crop in crops] == [
        "width:20px;height:15px;background-position:-10px -5px"
    ] * 2
    panes = page.all("div", role="region")
    assert [pane["tabindex"] for pane in panes] == ["0", "0"]
    for words in (
        "Improved : shake of 23 px, confident",
        "23.4 px over the frame",
        "confident (0.95)",
        "2.0 s",
        "deshake fix photo.jpg",
        "40 x 30 px, a part of the photo of 400 x 300 px",
    ):
        assert words in page.text


def test_a_photo_left_as_it_is_has_no_slider():
    left = entry(verdict="left", why="the photo looks sharp", extent_px=None, confidence=None)
    page = Page(whole([left], {1: pictures(left=True)}))
    assert "Left as it is : the photo looks sharp" in page.text
    assert page.all("input") == []
    assert len(page.all("img")) == len(page.all("div", role="img")) == 1
    assert "--after" not in page.all("article")[0]["style"]
    assert "Confidence" not in page.text


def test_a_failed_photo_has_its_reason_and_hint():
    failed = Entry(1, "a.jpg", "failed", "is no photo", "deshake fix a.jpg", hint="try another")
    page = Page(whole([failed]))
    assert "Failed : is no photo" in page.text
    assert "What to try: try another" in page.text
    assert page.all("img") == page.all("input") == []


def test_the_summary_has_a_row_a_photo_and_a_button_a_verdict():
    entries = [
        entry(1),
        entry(2, verdict="left", why="the photo looks sharp", extent_px=None, confidence=None),
        entry(3, verdict="left", why="a little soft", extent_px=None, confidence=None),
        entry(4, verdict="doubtful", confidence=0.3),
        entry(5, verdict="failed", why="is no photo"),
    ]
    page = Page(whole(entries))
    assert "1 improved, 2 left as they are, 1 doubtful, 1 failed" in page.text
    buttons = [each["value"] for each in page.all("button") if "value" in each]
    assert buttons == ["", "improved", "left", "doubtful", "failed"]
    rows = [row for row in page.all("tr") if row]
    assert [row["data-photo"] for row in rows] == [each["id"] for each in page.all("article")]
    cells = [cell["data-key"] for cell in page.all("td")][7:14]
    assert cells == ["2", "photo 2.jpg", "left", "the photo looks sharp", "-1", "-1", "2.0"]
    assert all(link["href"].startswith(("#p", "photo.")) for link in page.all("a"))


def test_one_photo_needs_no_summary():
    assert Page(whole([entry()])).all("table") == []


def test_only_a_page_of_many_leaves_out_what_is_not_seen():
    assert Page(whole([entry(n) for n in range(1, 4)])).all("main") == [{}]
    assert Page(whole([entry(n) for n in range(1, 60)])).all("main") == [{"class": "many"}]


@pytest.mark.parametrize("field", ["name", "why", "command", "result", "warnings", "hint"])
def test_nothing_that_a_name_holds_becomes_part_of_the_page(field):
    value = {"result": (HOSTILE, "a.jpg"), "warnings": [HOSTILE]}.get(field, HOSTILE)
    shown = {1: pictures(), 2: pictures(left=True)}
    harmless = {"name": "a", "why": "a", "command": "a", "result": ("a", "a.jpg")}
    harmless |= {"warnings": ["a"], "hint": "a"}
    plain = Page(whole([entry(**harmless), entry(2, **harmless)], shown))
    text = whole([entry(**harmless | {field: value}), entry(2, **harmless | {field: value})], shown)
    page = Page(text)
    assert [tag for tag, _ in page.elements] == [tag for tag, _ in plain.elements]
    assert [set(given) for _, given in page.elements] == [set(given) for _, given in plain.elements]
    assert printable(HOSTILE) in page.text
    assert "\\u202e" in page.text
    assert "\\x1b" in page.text
    text.encode("utf-8")


def test_the_page_asks_for_nothing_from_elsewhere():
    text = whole([entry(), entry(2)], {1: pictures(), 2: pictures(left=True)})
    assert "://" not in text
    assert not re.search(r"@import|fetch\(|XMLHttp|<link|<iframe|srcset", text)
    addresses = [given.get("src", "data:") for _, given in Page(text).elements]
    assert all(address.startswith("data:image/") or address == "data:" for address in addresses)
    assert "default-src 'none'" in text


def test_ids_are_there_once_and_labels_point_to_them():
    page = Page(whole([entry(), entry(2)], {1: pictures(), 2: pictures()}))
    ids = [given["id"] for _, given in page.elements if "id" in given]
    assert len(ids) == len(set(ids))
    assert {each["aria-labelledby"] for each in page.all("article")} <= set(ids)


def test_pictures_go_where_the_caller_puts_them():
    names = []

    def place(name, picture):
        names.append((name, picture.data))
        return f"folder/{name}.{picture.ending}"

    page = Page(whole([entry()], {1: pictures()}, place=place))
    assert [image["src"] for image in page.all("img")] == [
        "folder/frame-after.jpg",
        "folder/frame-before.jpg",
        "folder/kernel.png",
    ]
    assert "url('folder/part-before.jpg')" in page.all("article")[0]["style"]
    assert len(names) == 5


def test_embedded_pictures_hold_themselves():
    assert embedded("x", Encoded(b"\xff\xd8", 1, 1)) == "data:image/jpeg;base64,/9g="
