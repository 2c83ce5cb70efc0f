"""Measure deshake: one table at a time, as docs/benchmarks.md and docs/pairs.md have them.

    python scripts/bench.py TABLE [options]
    python scripts/bench.py TABLE --help

"Recordings" are logs of a phone in a hand. Photos come from scikit-image and scikit-learn, unless
a table says something else; docs/benchmarks.md says where all data are from.
"""

from __future__ import annotations

import sys
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from bench.program import explained, guarded, use_one_thread

if TYPE_CHECKING:
    from collections.abc import Sequence


class Table(NamedTuple):
    """What a table measures, and the data that it needs."""

    measures: str
    data: str = "no data"


TABLES = {
    "shakes": Table(
        "blind estimates: gain, confidence, cost",
        "--data recordings, --scenes; or rendered --cases",
    ),
    "replayed": Table("blind estimates for the photos of Köhler et al.", "--data those photos"),
    "replayed-results": Table("results for these photos, beside other programs'", "--results"),
    "restoration": Table("the methods of deblurring, with the true kernel", "--data recordings"),
    "sharp": Table(
        "photos without shake: none may become worse", "no data; two photos more: --data"
    ),
    "uniform": Table("uniform blur, against scikit-image"),
    "lens": Table("what it gains to undo a lens's distortion", "no data; the package lensfunpy"),
    "pair": Table("a blurred and a noisy photo", "--data recordings"),
    "pair-cost": Table("time and memory of a pair"),
    "operators": Table("time and memory of the operators, against their bare FFTs"),
    "cost": Table("time and memory of deblurring and of a blind estimate, by size"),
    "inspect": Table("verdicts on photos whose blur is known", "--cases that `shakes` rendered"),
    "fix": Table("time and memory of the commands, by size", "no data, or photos of your own"),
    "folders": Table("folders of photos: killed and resumed, photos an hour, memory"),
}


def listed() -> str:
    """List the tables, a line each."""
    lines = [f"  {name:16} {table.measures} (needs {table.data})" for name, table in TABLES.items()]
    return "\n".join(["tables:", *lines])


def main(argv: Sequence[str] | None = None) -> int:
    """Make one table."""
    given = list(sys.argv[1:] if argv is None else argv)
    parser = explained(__doc__, "bench.py")
    parser.epilog = listed()
    parser.usage = "bench.py TABLE [options]"
    parser.add_argument("table", choices=TABLES, metavar="TABLE", help="one of those below")
    name = parser.parse_known_args(given[:1])[0].table
    use_one_thread()
    table = import_module(f"bench.tables.{name.replace('-', '_')}")
    own = explained(table.__doc__, f"bench.py {name}")
    table.add_arguments(own)
    args = own.parse_args(given[1:])
    return guarded(partial(table.run, args))


if __name__ == "__main__":
    sys.exit(main())
