"""The memory for many photos at once: a limit, and what is available."""

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
"""Share of the available memory that is the limit by default."""

_CGROUPS = Path("/sys/fs/cgroup")
_OWN_CGROUP = Path("/proc/self/cgroup")


@dataclass(frozen=True)
class Budget:
    """The memory that all processes together may take.

    Parameters
    ----------
    limit : int
        The limit in bytes.
    given : bool
        Whether the user gave the limit. Then a photo that needs more is refused; otherwise it is
        worked on alone.

    """

    limit: int
    given: bool = False

    @classmethod
    def of(cls, limit: int | None) -> Budget:
        """Return the given budget, or `SHARE` of the available memory."""
        if limit is None:
            return cls(int(SHARE * available_memory()))
        return cls(limit, given=True)

    def admits(self, need: int, taken: Iterable[int]) -> bool:
        """Return whether there is room for one more photo; a first photo always has room."""
        others = sum(taken)
        return others == 0 or others + need <= self.limit

    def check(self, need: int, job: Job) -> None:
        """Refuse a photo that needs more memory than a given limit.

        Raises
        ------
        PhotoError
            If the photo needs more.

        """
        if self.given and need > self.limit:
            raise PhotoError(
                f"needs about {gigabytes(need)} of memory, more than --memory "
                f"{gigabytes(self.limit)}",
                hint="allow more with --memory, or make the photo smaller",
                file=job.source,
            )


def available_memory() -> int:
    """Return the bytes of memory that new work can take without displacing memory in use.

    This is the smallest of the system's available memory and the rest of each control group.
    """
    import psutil  # noqa: PLC0415 - for runs of many photos alone

    available = [int(psutil.virtual_memory().available)]
    try:
        lines = _OWN_CGROUP.read_text("utf-8").splitlines()
    except OSError:
        lines = []
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if not controllers:
            available += _left(_CGROUPS, path, "memory.max", "memory.current")
        elif "memory" in controllers.split(","):
            files = "memory.limit_in_bytes", "memory.usage_in_bytes"
            available += _left(_CGROUPS / "memory", path, *files)
    return max(min(available), 0)


def gigabytes(count: int) -> str:
    """Format a number of bytes."""
    return f"{count / 1e9:.2g} GB" if count >= 1e9 else f"{count / 1e6:.0f} MB"


def _left(root: Path, path: str, limit_file: str, usage_file: str) -> list[int]:
    """Return the bytes left to a control group and to each of its parents with a limit.

    Inactive file pages count as left, because the system frees them when it needs room.
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
