"""What all programs of this folder do: they fail with one line, and explain themselves."""

from __future__ import annotations

import argparse
import os
import sys
from typing import TYPE_CHECKING

from bench.errors import MissingDataError
from deshake.errors import DeshakeError, OutputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

__all__ = ["check_sheet_name", "explained", "guarded", "use_one_thread"]


def explained(text: str | None, name: str | None = None) -> argparse.ArgumentParser:
    """Make a parser whose help starts with a module's text, line by line."""
    return argparse.ArgumentParser(
        name, description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def guarded(work: Callable[[], int]) -> int:
    """Return the exit code of a program's work; if it fails on purpose, say why."""
    try:
        return work()
    except (DeshakeError, MissingDataError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        if hint := getattr(error, "hint", None):
            print(f"hint: {hint}", file=sys.stderr)
        return 1


def use_one_thread() -> None:
    """Use one thread for linear algebra, here if NumPy is not loaded yet, and in new processes."""
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"


def check_sheet_name(output: Path) -> None:
    """Raise OutputError if a sheet of pictures cannot have this name."""
    if output.suffix.lower() not in {".png", ".jpg", ".jpeg"}:
        raise OutputError("the sheet's name must end in .png or .jpg", file=output)
