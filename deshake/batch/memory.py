"""How much memory there is for many photos at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from deshake.errors import PhotoError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from deshake.batch.plan import Job

__all__ = ["Budget", "available_memory", "gigabytes"]

SHARE: Final = 0.7
"""Of the memory that is available, what is taken unless something else is said."""

_CGROUPS = Path("/sys/fs/cgroup")
_OWN_CGROUP = Path("/proc/self/cgroup")


@dataclass(frozen=True)
class Budget:
    """The memory that all processes together may take.

    Parameters
    ----------
    limit : int
        In bytes.
    given : bool
        Whether the user named it: then no photo that needs more is begun. Else one that does is
        worked on alone.

    """

    limit: int
    given: bool = False

    @classmethod
    def of(cls, limit: int | None) -> Budget:
        """Return the budget that was asked for, or `SHARE` of what is available."""
        if limit is None:
            return cls(int(SHARE * available_memory()))
        return cls(limit, given=True)

    def admits(self, need: int, taken: Iterable[int]) -> bool:
        """Tell whether there is room for one more photo; for a first one there always is."""
        others = sum(taken)
        return others == 0 or others + need <= self.limit

    def check(self, need: int, job: Job) -> None:
        """Refuse a photo that needs more than was given.

        Raises
        ------
        PhotoError
            If it does.

        """
        if self.given and need > self.limit:
            raise PhotoError(
                f"needs about {gigabytes(need)} of memory, more than --memory "
                f"{gigabytes(self.limit)}",
                hint="allow more, or make the photo smaller",
                file=job.source,
            )


def available_memory() -> int:
    """Return the bytes of memory that new work can take without pushing out what is in use.

    That is what the system has, or what is left to this process's control groups if it is less.
    """
    import psutil  # noqa: PLC0415 - for runs of many photos alone

    found = [int(psutil.virtual_memory().available)]
    try:
        lines = _OWN_CGROUP.read_text("utf-8").splitlines()
    except OSError:
        lines = []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if not controllers:
            found += _left(_CGROUPS, path, "memory.max", "memory.current")
        elif "memory" in controllers.split(","):
            files = "memory.limit_in_bytes", "memory.usage_in_bytes"
            found += _left(_CGROUPS / "memory", path, *files)
    return max(min(found), 0)


def gigabytes(count: int) -> str:
    """Say a number of bytes."""
    return f"{count / 1e9:.2g} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"


def _left(root: Path, path: str, limit_file: str, usage_file: str) -> list[int]:
    """Return what is left to a control group and each of those above it that have a limit.

    Pages of files that nobody uses count as left: the system drops them when it needs room.
    """
    left = []
    group = root / path.lstrip("/")
    for folder in (group, *group.parents):
        if not folder.is_relative_to(root):
            break
        try:
            limit = (folder / limit_file).read_text("ascii").strip()
            usage = int((folder / usage_file).read_text("ascii"))
            stat = (folder / "memory.stat").read_text("ascii").split()
        except (OSError, ValueError):
            continue
        if limit.isdecimal():  # else "max"
            idle = dict(zip(stat[::2], stat[1::2], strict=False)).get("inactive_file", "0")
            left.append(int(limit) - usage + int(idle))
    return left
