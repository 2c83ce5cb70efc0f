"""Compare what the commands write at two commits, byte by byte.

    python scripts/compare_commits.py main HEAD
    python scripts/compare_commits.py main HEAD --only pair

Each commit is checked out in a temporary worktree, and each of the cases below is run there by the
same interpreter, on the same small inputs. Files and figures (standard output) must have the same
bytes and the exit codes must agree; the version, which provenance carries, is set to the same
number in both worktrees. Messages (standard error) may differ: `--messages` compares them, too.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from PIL import Image

from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

ROOT = Path(__file__).parent.parent
TIMED = re.compile(r'"seconds": [0-9.]+, |; \d+:\d\d:\d\d$', re.MULTILINE)
LENS = "--focal-px 150"
TINY = "--focal-35mm 40 --blur-size 3"  # left as they are: hardly a shake
PAIR = f"{LENS} --blur-size 8"

# A case is a chain of commands in a folder of its own that has the inputs of `write_inputs`.
CASES = {
    "calibrate": [
        "calibrate small.jpg -o camera.npz --focal-35mm 28 --json",
        "calibrate small.jpg --focal-px 900 -v",
        "calibrate small.jpg",
        "calibrate folder -o cameras --focal-35mm 28 --json",
        "calibrate folder -o cameras --focal-35mm 28 --json --skip-existing",
        "calibrate folder -o cameras --focal-35mm 28 --json --dry-run",
        "calibrate --chessboard --board 6x4 board1.png board2.png board3.png -o board.npz --json",
    ],
    "simulate": [
        "simulate sharp.png -o shaken.png --kernel true.npz --blur-size 8 --seed 1",
        "simulate sharp.png --path path.txt --noise 0.01 --photons 2000 --gain 1.5 --keep-size",
        "simulate sharp.png -o shaken.jpg --sharp same.jpg --blur-size 6 --focal-35mm 28",
        "render-kernel true.npz",
        "render-kernel true.npz --filters 3x4 -o filters.png --size 400",
    ],
    "estimate": [
        "simulate sharp.png -o shaken.jpg --kernel true.npz --blur-size 9 --seed 3 --focal-35mm 40",
        "estimate-blind shaken.jpg -o kernel.npz --focal-35mm 40 --blur-size 12 --json",
        "fix shaken.jpg -o sharp.jpg --focal-35mm 40 --blur-size 12 --keep-kernels kernels --json",
        "deblur shaken.jpg kernel.npz -o stages.jpg",
    ],
    "variational": [
        f"estimate-blind small.jpg -o v.npz {TINY} --estimator variational --uniform --json",
    ],
    "blind": [
        f"fix small.jpg {TINY} --uniform",
        f"fix small.png {TINY} --uniform -o other.tif --transfer linear",
        f"fix deep.png {TINY} --uniform --strength 0.5 --mask mask.png --compare --json",
        f"fix folder -o results {TINY} --uniform --json -j 2",
        f"fix folder -o results {TINY} --uniform --json --skip-existing",
        f"fix folder -o results {TINY} --uniform --json --skip-existing --quality fast",
        f"fix folder -o dry {TINY} --uniform --json --dry-run",
        f"estimate-blind small.jpg {TINY} --uniform --tiles t.png --latent l.png",
        f"estimate-blind small.jpg {TINY} --uniform --region 5,5,60,60 -o -",
        "fix missing.jpg --json",
        "fix broken.jpg --json",
        "fix small.jpg -o small.jpg",
    ],
    "deblur": [
        "deblur small.jpg pan.npz -o default.jpg --json",
        "deblur deep.png pan.npz -o fast.png --quality fast",
        "deblur deep.tif pan.npz -o high.tif --quality high",
        "deblur small.jpg pan.npz -o rl.png --method rl --iterations 4",
        "deblur small.jpg pan.npz -o noise.png --method rl",
        "deblur small.jpg pan.npz -o accelerated.png --method rl-accelerated --iterations 4",
        "deblur grey.png pan.npz -o tv.png --method rl-tv --iterations 4",
        "deblur small.jpg uniform.npz -o wiener.png --method wiener",
        "deblur small.jpg uniform.npz -o unsupervised.png --method unsupervised-wiener",
        "deblur small.jpg pan.npz -o preview.jpg --preview --compare --no-provenance",
        "deblur folder --kernel pan.npz -o results --iterations 2 --json --compare",
        "deblur folder --kernel pan.npz -o results --iterations 2 --json --skip-existing",
        "deblur small.jpg pan.npz -o bent.npz",
        "deblur small.jpg lens.npz -o straight.jpg --iterations 2",
        "deblur small.jpg lens.npz -o curved.jpg --iterations 2 --keep-geometry",
        "deblur small.jpg pan.npz -o wrong.jpg --method residual",
    ],
    "pair": [
        f"register blurred.png noisy.png {LENS} -o pair.npz --preview overlay.png --json",
        "estimate-pair blurred.png noisy.png --registration pair.npz -o k.npz --blur-size 8 --json",
        "deblur blurred.png k.npz --noisy noisy.png --registration pair.npz -o stages.png --json",
        "deblur blurred.png k.npz --noisy noisy.png -o again.png --quality fast",
        f"fix blurred.png --noisy noisy.png -o fixed.png {PAIR} --keep-kernels kernels --json",
        f"fix blurred.png --noisy noisy.png -o fixed.png {PAIR} --skip-existing --json",
        f"fix blurred.png --noisy noisy.png -o dry.png {PAIR} --dry-run --json",
    ],
    "pair options": [
        f"fix blurred.png --noisy noisy.png -o r.jpg {PAIR} --uniform --method residual --compare",
        f"fix blurred.jpg --noisy noisy.png -o p.tif {PAIR} --uniform --preview",
        f"fix blurred.png --noisy noisy.png -o m.png {PAIR} --strength 0.7 --mask soft.png",
        "fix blurred.png --noisy noisy.png --method rl",
        "register blurred.png small.jpg --focal-px 150",
    ],
}


def texture(height: int, width: int, seed: int) -> NDArray[np.float32]:
    """Make a picture (H, W, 3) with edges at every angle, display values 0..1."""
    random = np.random.default_rng(seed)
    coarse = random.random((height // 10, width // 10, 3), np.float32)
    smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    edges = (cv2.resize(coarse[..., :1], (width, height), interpolation=2) > 0.5)[..., None]
    picture: NDArray[np.float32] = np.clip(0.35 + 0.9 * (smooth - 0.5) + 0.3 * edges, 0.03, 0.97)
    return picture


def board(turn: tuple[float, float, float]) -> NDArray[np.uint8]:
    """Photograph a board of 6 x 4 inner corners that is turned by angles in radians."""
    squares = np.kron(np.indices((5, 7)).sum(0) % 2, np.ones((40, 40)))
    flat = np.pad(60 + 170 * squares, 60, constant_values=230).astype(np.uint8)
    height, width = flat.shape
    to_plane = np.array([[1, 0, -width / 2], [0, 1, -height / 2], [0, 0, 0], [0, 0, 1.0]])
    rotation = cv2.Rodrigues(np.array(turn))[0]
    pose = np.column_stack([rotation, [0, 0, 500.0]])
    camera = np.array([[480, 0, 199.5], [0, 480, 149.5], [0, 0, 1.0]])
    moved = cv2.warpPerspective(flat, camera @ pose @ to_plane, (400, 300), borderValue=230)
    return np.asarray(cv2.GaussianBlur(moved, (0, 0), 0.8), np.uint8)


def save(path: Path, picture: NDArray[np.float32], depth: int = 8) -> None:
    """Write a picture of display values; with 16 bits if asked."""
    most = 2**depth - 1
    codes = np.rint(most * picture).astype(np.uint16 if depth > 8 else np.uint8)
    if depth > 8:
        path.write_bytes(cv2.imencode(path.suffix, codes[..., ::-1])[1].tobytes())
    else:
        Image.fromarray(codes).save(path, quality=92)


def write_kernels(folder: Path) -> None:
    """Write kernels of a pan for photos of 100 x 80: general, uniform, and through a lens."""
    camera = Camera.from_focal(120, 80, 100)
    path = [(-0.01, -0.01, 0), (0.01, 0.01, 0.01)]
    bends = camera.with_lens(np.array([-0.1, 0.02, 0.0, 0.0, 0.0]))
    flat = Camera.uniform(80, 100)
    shift = 3 / flat.focal_px
    kernels = {
        "pan": RotationKernel.from_path(path, camera),
        "lens": RotationKernel.from_path(path, bends),
        "uniform": RotationKernel.from_path([(0, -shift / 2, 0), (0, shift / 2, 0)], flat),
    }
    for name, kernel in kernels.items():
        write_kernel(folder / f"{name}.npz", KernelFile(kernel))


def write_inputs(folder: Path) -> None:
    """Write the photos, the path and the masks that the cases read."""
    blur = np.eye(3, dtype=np.float32) / 3
    small = cv2.filter2D(texture(80, 100, 5), -1, blur)
    save(folder / "small.jpg", small)
    save(folder / "small.png", small)
    save(folder / "deep.png", small, 16)
    save(folder / "deep.tif", small, 16)
    Image.fromarray(np.rint(255 * small[..., 1]).astype(np.uint8)).save(folder / "grey.png")
    (folder / "broken.jpg").write_bytes((folder / "small.jpg").read_bytes()[:900])
    (folder / "folder" / "more").mkdir(parents=True)
    save(folder / "folder" / "a.jpg", small[:, ::-1])
    save(folder / "folder" / "b.png", small[::-1])
    (folder / "folder" / "c.jpg").write_bytes(b"no photo")
    save(folder / "sharp.png", texture(170, 220, 7))
    rows = "\n".join(f"{0.05 * i},{0.3 * i * i / 9:.4f},{0.1 * i}" for i in range(5))
    (folder / "path.txt").write_text(rows + "\n", "ascii")
    ramp = np.tile(np.linspace(0, 255, 100).astype(np.uint8), (80, 1))
    Image.fromarray(ramp).save(folder / "mask.png")
    Image.fromarray(ramp).resize((140, 100)).save(folder / "soft.png")
    scene = cv2.GaussianBlur(texture(100, 140, 11), (0, 0), 0.7)
    light = scene**2.2
    long = cv2.filter2D(light, -1, np.full((1, 5), 0.2, np.float32))
    noise = np.random.default_rng(0).normal(0, 0.004, light.shape)
    shifted = np.roll(light, (1, 2), (0, 1)) / 4
    save(folder / "blurred.png", long ** (1 / 2.2), 16)
    save(folder / "blurred.jpg", long ** (1 / 2.2))
    save(folder / "noisy.png", np.clip(shifted + noise, 0, 1) ** (1 / 2.2), 16)
    turns = [(0.4, 0.1, 0.0), (-0.4, 0.3, 0.1), (0.1, -0.5, -0.1)]
    for number, turn in enumerate(turns, 1):
        Image.fromarray(board(turn)).save(folder / f"board{number}.png")
    write_kernels(folder)


@dataclass
class Run:
    """What one case left at one commit: exit codes, figures, messages, files by name."""

    codes: list[int] = field(default_factory=list)
    figures: list[str] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)


def run_case(lines: Sequence[str], code: Path, inputs: Path, folder: Path) -> Run:
    """Run the commands of a case with the package of a worktree, in a folder of their own."""
    subprocess.run(["cp", "-r", inputs, folder], check=True)  # noqa: S603, S607
    clean = {name: value for name, value in os.environ.items() if not name.startswith("DESHAKE_")}
    env = clean | {
        "PYTHONPATH": str(code),
        "PYTHONDONTWRITEBYTECODE": "1",
        "DESHAKE_NO_CONFIG": "1",
    }
    result = Run()
    for line in lines:
        words = [*line.split(), "--threads", "1", "--no-progress"]
        done = subprocess.run(  # noqa: S603
            [sys.executable, "-m", "deshake", *words],
            cwd=folder,
            env=env,
            capture_output=True,
            check=False,
        )
        result.codes.append(done.returncode)
        binary = done.stdout.startswith(b"PK")
        digest = hashlib.sha256(done.stdout).hexdigest()
        result.figures.append(digest if binary else in_order(done.stdout))
        result.messages.append(in_order(done.stderr))
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            result.files[str(path.relative_to(folder))] = path.read_bytes()
    return result


def in_order(printed: bytes) -> str:
    """Sort printed lines, since photos that are worked on at once end in any order; cut times."""
    return "\n".join(sorted(TIMED.sub("", printed.decode("utf-8")).splitlines()))


def differences(lines: Sequence[str], old: Run, new: Run, *, messages: bool) -> Iterator[str]:
    """Name what differs between two runs of a case."""
    for number, line in enumerate(lines):
        if old.codes[number] != new.codes[number]:
            last = (new.messages[number].splitlines() or [""])[-1]
            yield f"{line}: exit code {old.codes[number]} -> {new.codes[number]}: {last}"
        kinds = [("figures", old.figures, new.figures)]
        if messages:
            kinds.append(("messages", old.messages, new.messages))
        for kind, before, after in kinds:
            if before[number] != after[number]:
                pieces = (
                    text[number].replace(", ", ",\n").splitlines() for text in (before, after)
                )
                yield f"{line}: other {kind}"
                yield from list(difflib.unified_diff(*pieces, "old", "new", n=0, lineterm=""))[2:]
    for name in sorted(old.files.keys() | new.files.keys()):
        if name not in new.files:
            yield f"{name}: is missing"
        elif name not in old.files:
            yield f"{name}: is new"
        elif old.files[name] != new.files[name]:
            yield f"{name}: other bytes"


def check_out(commit: str, folder: Path) -> None:
    """Check a commit out in a folder, and give it the version that both commits carry."""
    git("worktree", "add", "--quiet", "--detach", str(folder), commit)
    front = folder / "deshake" / "__init__.py"
    for path in (front, folder / "deshake" / "version.py"):
        if path.exists():
            text = re.sub(
                r'(?m)^(__version__.*= )".*"$', r'\1"0.compared"', path.read_text("utf-8")
            )
            path.write_text(text, "utf-8")


def git(*words: str) -> None:
    """Run git in the repository."""
    subprocess.run(["git", "-C", str(ROOT), *words], check=True)  # noqa: S603, S607


def compare(old: str, new: str, names: Sequence[str], folder: Path, *, messages: bool) -> int:
    """Run cases at two commits and print what differs; return how many cases differ."""
    inputs = folder / "inputs"
    inputs.mkdir()
    write_inputs(inputs)
    trees = {"old": folder / "old", "new": folder / "new"}
    count = 0
    try:
        for (side, tree), commit in zip(trees.items(), (old, new), strict=True):
            check_out(commit, tree)
            (folder / f"runs-{side}").mkdir()
        for name in names:
            start = time.perf_counter()
            old_run, new_run = (
                run_case(CASES[name], tree, inputs, folder / f"runs-{side}" / name)
                for side, tree in trees.items()
            )
            lines = list(differences(CASES[name], old_run, new_run, messages=messages))
            count += bool(lines)
            written = len(new_run.files) - len([p for p in inputs.rglob("*") if p.is_file()])
            what = f"{len(CASES[name])} commands, {written} files written"
            codes = json.dumps(old_run.codes)
            took = time.perf_counter() - start
            verdict = "DIFFERENT" if lines else "same"
            print(f"{verdict:9} {name}: {what}, exit codes {codes} ({took:.0f} s)", flush=True)
            for line in lines:
                print(f"    {line}", flush=True)
    finally:
        for tree in trees.values():
            if tree.exists():
                git("worktree", "remove", "--force", str(tree))
    return count


def main() -> int:
    """Read the command line and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("old", help="commit to compare with")
    parser.add_argument("new", nargs="?", default="HEAD", help="commit that is compared")
    parser.add_argument("--only", metavar="WORD", default="", help="cases whose name has this word")
    parser.add_argument("--messages", action="store_true", help="compare standard error, too")
    options = parser.parse_args()
    names = [name for name in CASES if options.only in name]
    with tempfile.TemporaryDirectory() as folder:
        count = compare(options.old, options.new, names, Path(folder), messages=options.messages)
    print(f"{len(names) - count} of {len(names)} cases have the same bytes")
    return 1 if count or not names else 0


if __name__ == "__main__":
    sys.exit(main())
