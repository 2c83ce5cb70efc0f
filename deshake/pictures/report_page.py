"""The page of a report: one HTML file with all that it shows, for photos before and after.

The page is written in pieces, a photo at a time: `page_head`, an `article` a photo, `page_tail`.
"""

from __future__ import annotations

import base64
import html
from collections import Counter
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING, Final

from deshake.blind.trust import two_digits
from deshake.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from deshake.pictures.report_pictures import Encoded, ReportPictures

    Place = Callable[[str, Encoded], str]

__all__ = ["VERDICTS", "Entry", "article", "embedded", "page_head", "page_tail", "printable"]

VERDICTS: Final = {
    "improved": "improved",
    "left": "left as it is",
    "doubtful": "doubtful",
    "failed": "failed",
    "skipped": "skipped",
    "unshaken": "not shaken",
}
"""The outcomes of a photo, and their words on the page."""

_PLURAL: Final = {"left": "left as they are"}
_COLUMNS: Final = {
    "No.": "number",
    "Photo": "text",
    "Verdict": "text",
    "Why": "text",
    "Shake, px": "number",
    "Confidence": "number",
    "Time, s": "number",
}
_DRAWN: Final = {
    "kernel": (
        "The paths that points of light draw in nine places of the photo",
        "The path of the shake in nine places of the photo",
    ),
    "moving": (
        "The frame, with a colour where the result keeps the photo",
        "In colour: the blur is not the camera's, so the photo is kept",
    ),
}
"""The pictures beside the figures: what they show, and their captions."""
_MANY: Final = 40  # photos; with more, the browser draws only the visible ones
_UNKNOWN: Final = "-1"  # sorts before all numbers


@dataclass(frozen=True)
class Entry:
    """The words and figures of the page for one photo.

    Parameters
    ----------
    number : int
        Its place among the photos, from 1.
    name : str
        The photo's file.
    verdict : str
        One of `VERDICTS`.
    why : str
        The reason, or what was done, in a few words.
    command : str
        The command that makes the result again.
    seconds : float
        Time that it took.
    result : (str, str), optional
        The result's file, and its address relative to the page.
    extent_px, confidence : float, optional
        Figures of the kernel of the deblurring.
    confidence_words : str
        The confidence in words.
    warnings : sequence of str
        The warnings.
    hint : str, optional
        What to try, if the photo failed.

    """

    number: int
    name: str
    verdict: str
    why: str
    command: str
    seconds: float = 0.0
    result: tuple[str, str] | None = None
    extent_px: float | None = None
    confidence: float | None = None
    confidence_words: str = ""
    warnings: Sequence[str] = ()
    hint: str | None = None


def printable(text: str) -> str:
    """Return a text; characters that cannot be printed, or reverse the line, are spelt out."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def embedded(_name: str, picture: Encoded) -> str:
    """Return the address of a picture that holds the picture itself."""
    kind = {"jpg": "jpeg"}.get(picture.ending, picture.ending)
    return f"data:image/{kind};base64,{base64.b64encode(picture.data).decode('ascii')}"


def page_head(entries: Sequence[Entry], command: str) -> str:
    """Return the page up to the first photo: title, style, and the summary of several photos.

    Parameters
    ----------
    entries : sequence of Entry
        All photos, in their order.
    command : str
        The command that made the page.

    """
    count = Counter(entry.verdict for entry in entries)
    several = len(entries) != 1
    parts = [
        f"{count[verdict]} {_PLURAL.get(verdict, words) if count[verdict] != 1 else words}"
        for verdict, words in VERDICTS.items()
        if count[verdict]
    ]
    title = f"{len(entries)} photos" if several else entries[0].name
    return Template(_asset("report.html")).substitute(
        version=_text(__version__),
        title=_text(f"deshake: {title}"),
        style=_asset("report.css").strip(),
        counts=_text(", ".join(parts)),
        command=_text(command),
        summary=_summary(entries, count) if several else "",
        kind=' class="many"' if len(entries) > _MANY else "",
    )


def page_tail() -> str:
    """Return the page after the last photo."""
    return f"</main>\n<script>\n{_asset('report.js').strip()}\n</script>\n</body>\n</html>\n"


def article(entry: Entry, pictures: ReportPictures | None, place: Place = embedded) -> str:
    """Return what the page shows of one photo.

    Parameters
    ----------
    entry : Entry
        Its words and figures.
    pictures : ReportPictures or None
        Its pictures, if there are any.
    place : callable
        Receives the name of a picture, and the picture; returns its address, in ASCII.

    """
    number, name = entry.number, _text(entry.name)
    lines = [
        f'<h2 id="h{number}">{name}</h2>',
        f'<p><span class="verdict">{_verdict(entry)}</span>: {_text(entry.why)}</p>',
    ]
    if entry.hint:
        lines.append(f"<p>What to try: {_text(entry.hint)}</p>")
    style = ""
    if pictures is not None:
        parts = {"before": pictures.part, "after": pictures.part_after}
        addresses = {
            kind: place(f"part-{kind}", part) for kind, part in parts.items() if part is not None
        }
        style = ";".join(f"--{kind}:url('{to}')" for kind, to in addresses.items())
        style = f' style="{html.escape(style)}"'
        lines += [_slider(entry, pictures, place), _detail(pictures), _around(pictures)]
    lines.append(_facts(entry, pictures, place))
    head = f'<article id="p{number}" class="{entry.verdict}" aria-labelledby="h{number}"{style}>'
    return "\n".join([head, *lines, "</article>\n"])


def _summary(entries: Sequence[Entry], count: Counter[str]) -> str:
    """Return the tools to filter the photos, and the table to sort them."""
    buttons = [f'<button type="button" value="" aria-pressed="true">All {len(entries)}</button>']
    buttons += [
        f'<button type="button" value="{verdict}" aria-pressed="false">'
        f"{_text(words.capitalize())} {count[verdict]}</button>"
        for verdict, words in VERDICTS.items()
        if count[verdict]
    ]
    heads = [
        f'<th scope="col" data-kind="{kind}"><button type="button">{name}</button></th>'
        for name, kind in _COLUMNS.items()
    ]
    return "\n".join(
        [
            '<div class="tools" role="group" aria-label="Filter">',
            *buttons,
            '<input type="search" aria-label="Part of a name or a reason" placeholder="Search">',
            '<span id="shown" class="note" role="status"></span>',
            "</div>",
            '<div class="table" role="region" aria-label="Summary" tabindex="0">',
            f"<table><thead><tr>{''.join(heads)}</tr></thead>",
            "<tbody>",
            *map(_row, entries),
            "</tbody></table></div>",
        ]
    )


def _row(entry: Entry) -> str:
    """Return a photo's line of the table."""
    name = f'<a href="#p{entry.number}">{_text(entry.name)}</a>'
    extent = "" if entry.extent_px is None else f"{entry.extent_px:.1f}"
    trust = "" if entry.confidence is None else two_digits(entry.confidence)
    cells = [
        ("number", str(entry.number), str(entry.number)),
        ("name", _attribute(entry.name), name),
        ("verdict " + entry.verdict, entry.verdict, _verdict(entry)),
        ("why", _attribute(entry.why), _text(entry.why)),
        ("number", extent or _UNKNOWN, extent),
        ("number", trust or _UNKNOWN, trust),
        ("number", f"{entry.seconds:.1f}", f"{entry.seconds:.1f}"),
    ]
    row = "".join(f'<td class="{kind}" data-key="{key}">{cell}</td>' for kind, key, cell in cells)
    return f'<tr class="{entry.verdict}" data-photo="p{entry.number}">{row}</tr>'


def _slider(entry: Entry, pictures: ReportPictures, place: Place) -> str:
    """Return the whole frame before and after; of a photo left as it is, the photo."""
    before, after = pictures.before, pictures.after
    size = f'width="{before.width}" height="{before.height}" decoding="async" loading="lazy"'
    name = _attribute(entry.name)
    one = html.escape(place("frame-before", before))
    if after is None:
        width = f'style="max-width:{before.width}px"'
        return f'<img class="whole" {width} {size} alt="{name}" src="{one}">'
    two = html.escape(place("frame-after", after))
    value = 'min="0" max="100" step="any" value="50"'
    return "\n".join(
        [
            f'<div class="slider" style="width:{before.width}px">',
            f'<img {size} alt="After: {name}" src="{two}">',
            f'<img class="before" {size} alt="Before: {name}" src="{one}">',
            '<span class="edge"></span>',
            '<span class="tag one">before</span><span class="tag two">after</span>',
            f'<input type="range" {value} aria-label="Before and after: {name}">',
            "</div>",
        ]
    )


def _detail(pictures: ReportPictures) -> str:
    """Return the most detailed place at 100 %."""
    x, y, width, height = pictures.detail
    style = f"width:{width}px;height:{height}px;background-position:{-x}px {-y}px"
    shown = _windows(
        pictures,
        lambda side, words: (
            f'<div class="crop {side}" role="img" aria-label="{words}, a detail at 100 %" '
            f'style="{style}"></div>'
        ),
    )
    return f"<h3>Detail at 100 %</h3>\n{shown}"


def _around(pictures: ReportPictures) -> str:
    """Return the part at 100 % in windows that can be moved over it."""
    x, y, width, height = pictures.detail
    part = pictures.part
    rows, columns = pictures.shape
    whole = (part.height, part.width) == (rows, columns)
    what = "the whole photo" if whole else "a part of the photo"
    shown = _windows(
        pictures,
        lambda side, words: (
            f'<div class="pan" tabindex="0" role="region" aria-label="{words} at 100 %" '
            f'data-x="{x}" data-y="{y}" data-w="{width}" data-h="{height}">'
            f'<div class="{side}" style="width:{part.width}px;height:{part.height}px"></div></div>'
        ),
    )
    size = f"{part.width} x {part.height} px, {what} of {columns} x {rows} px."
    return "\n".join(
        [
            '<details class="around"><summary>Look around at 100 %</summary>',
            f'<p class="note">{size} Drag, swipe, or use the arrow keys.</p>',
            '<p><button type="button">Back to the detail</button></p>',
            shown,
            "</details>",
        ]
    )


def _windows(pictures: ReportPictures, window: Callable[[str, str], str]) -> str:
    """Return a window for before and, unless the photo was left as it is, one for after."""
    sides = {"b": "Before", "a": "After"}
    if pictures.part_after is None:
        sides = {"b": "The photo"}
    shown = [
        f"<figure>{window(side, words)}<figcaption>{words}</figcaption></figure>"
        for side, words in sides.items()
    ]
    return f'<div class="pair">{"".join(shown)}</div>'


def _figure(name: str, picture: Encoded, place: Place) -> str:
    """Return one of the pictures beside the figures."""
    what, caption = _DRAWN[name]
    source = html.escape(place(name, picture))
    return (
        f'<figure><img class="kernel" width="{picture.width}" height="{picture.height}" '
        f'alt="{what}" loading="lazy" src="{source}"><figcaption>{caption}</figcaption></figure>'
    )


def _facts(entry: Entry, pictures: ReportPictures | None, place: Place) -> str:
    """Return the kernel and the figures."""
    drawn = {} if pictures is None else {"kernel": pictures.kernel, "moving": pictures.moving}
    figures = "".join(
        _figure(name, picture, place) for name, picture in drawn.items() if picture is not None
    )
    facts: list[tuple[str, str]] = []
    if entry.extent_px is not None:
        facts.append(("Shake", f"{entry.extent_px:.1f} px over the frame"))
    if entry.confidence is not None:
        facts.append(
            ("Confidence", f"{_text(entry.confidence_words)} ({two_digits(entry.confidence)})")
        )
    if entry.result is not None:
        name, address = entry.result
        facts.append(("Result", f'<a href="{_attribute(address)}">{_text(name)}</a>'))
    facts.append(("Time", f"{entry.seconds:.1f} s"))
    facts += [("Note", _text(warning)) for warning in entry.warnings]
    items = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in facts)
    return (
        f'<h3>How</h3>\n<div class="facts">{figures}<div><dl>{items}</dl>\n'
        f"<p>Command</p><pre><code>{_text(entry.command)}</code></pre></div></div>"
    )


def _verdict(entry: Entry) -> str:
    return _text(VERDICTS[entry.verdict].capitalize())


def _text(text: str) -> str:
    """Escape a text for the page."""
    return html.escape(printable(text))


def _attribute(text: str) -> str:
    """Escape a text for an attribute."""
    return html.escape(printable(text), quote=True)


@cache
def _asset(name: str) -> str:
    return files("deshake.pictures").joinpath(name).read_text("utf-8")
