from __future__ import annotations

import time

import numpy as np
import pytest
from PIL import Image

from deshake.errors import KernelFileError, OutputError
from deshake.files.kernel_file import KernelFile, write_kernel
from deshake.pictures.render import render_comparison, render_file, render_filters, render_kernel

NAMES = ["delta", "flat", "roll", "path", "far", "uniform", "cloud"]


@pytest.mark.parametrize("name", NAMES)
def test_every_kernel_has_a_picture(kernels, name):
    start = time.process_time()
    picture = render_kernel(kernels[name], size=400)
    assert picture.shape == (400, 400, 3)
    assert picture.dtype == np.uint8
    assert (picture[0] == 255).all()
    assert (picture[:, -1] == 255).all()  # no label runs out of the picture
    assert (picture[:, 0] == 255).all()
    assert picture.std() > 5
    assert time.process_time() - start < 10


def test_a_comparison_is_side_by_side_on_common_axes(kernels):
    both = {"true": kernels["flat"], "estimated": kernels["roll"]}
    picture = render_comparison(both, size=300)
    assert picture.shape == (300, 600, 3)
    same = render_comparison({"true": kernels["flat"], "other": kernels["flat"]}, size=300)
    below = slice(60, None)  # the title
    assert (same[below, :300] == same[below, 300:]).all()
    alone = render_comparison({"true": kernels["uniform"]}, size=300)
    assert alone.shape == (300, 300, 3)
    with pytest.raises(ValueError, match="no kernel"):
        render_comparison({})


def cells(picture, rows, cols, height, width):
    """The cells of a picture of filters, without their borders."""
    grey = picture[:height, :width].astype(float).mean(-1)
    for r in range(rows):
        for c in range(cols):
            y, x = (
                slice(r * height // rows, (r + 1) * height // rows),
                slice(c * width // cols, (c + 1) * width // cols),
            )
            cell = grey[y, x][3:-3, 3:-3]
            yield cell - cell.min()


def spread(cell):
    """Standard deviations of a filter along x and y, and its centroid off the middle."""
    y, x = np.mgrid[: cell.shape[0], : cell.shape[1]]
    x, y = x - (cell.shape[1] - 1) / 2, y - (cell.shape[0] - 1) / 2
    share = np.where(cell > 30, cell, 0)
    share = share / share.sum()
    mx, my = (share * x).sum(), (share * y).sum()
    return np.sqrt((share * x**2).sum() - mx**2), np.sqrt((share * y**2).sum() - my**2), mx, my


def test_filters_of_a_turn_about_y_run_along_x(kernels):
    picture = render_filters(kernels["flat"], 2, 2, size=400)
    for cell in cells(picture, 2, 2, 300, 400):
        along, across, _, _ = spread(cell)
        assert along > 4 * across


def test_filters_of_a_roll_run_around_the_middle(kernels):
    picture = render_filters(kernels["roll"], 3, 3, size=600)
    sizes = [spread(cell)[:2] for cell in cells(picture, 3, 3, 450, 600)]
    above, left, middle, right, below = (sizes[k] for k in (1, 3, 4, 5, 7))
    assert above[0] > 4 * above[1]
    assert below[0] > 4 * below[1]
    assert left[1] > 4 * left[0]
    assert right[1] > 4 * right[0]
    assert max(middle) < 0.5 * above[0]


def test_filters_show_where_a_point_is_seen(kernels):
    # H_k moves p along +x for a turn about +Y, so the photo shows it at -x: g(x) = f(H_k x).
    kernel = kernels["flat"]
    shifted = kernel.shifted((0, 15, 0))
    ((moved_x, moved_y),) = shifted.displacements([(399.5, 299.5)]).mean(1)
    assert moved_x > 5
    (cell,) = cells(render_filters(shifted, 1, 1, size=400), 1, 1, 300, 400)
    _, _, x, y = spread(cell)
    assert x < -20
    assert abs(y) < 3 + abs(moved_y)


def test_filters_of_the_uniform_model_are_all_the_same(kernels):
    picture = render_filters(kernels["uniform"], 2, 4, size=400)
    first, *others = (spread(cell) for cell in cells(picture, 2, 4, 300, 400))
    for other in others:
        assert other == pytest.approx(first, abs=0.3)


@pytest.mark.parametrize("name", NAMES)
def test_filters_of_every_kernel(kernels, name):
    picture = render_filters(kernels[name], 3, 4, size=400)
    assert picture.shape[1:] == (400, 3)
    for cell in cells(picture, 3, 4, 300, 400):
        assert cell.max() > 200  # as bright as its brightest spot


def test_many_filters_get_room(kernels):
    picture = render_filters(kernels["path"], 40, 40, size=200)
    assert picture.shape[1] >= 40 * 12


@pytest.fixture
def kernel_file(kernels, tmp_path):
    path = tmp_path / "shake.npz"
    write_kernel(path, KernelFile(kernels["path"]))
    return path


def test_a_file_is_drawn_beside_the_kernel(kernels, kernel_file):
    assert render_file(kernel_file) == kernel_file.with_name("shake.png")
    with Image.open(kernel_file.with_name("shake.png")) as image:
        assert (np.asarray(image) == render_kernel(kernels["path"])).all()
    assert render_file(kernel_file, filters=(2, 3), size=300).name == "shake-filters.png"


def test_the_same_kernel_gives_the_same_bytes(kernel_file, tmp_path):
    one, two = (render_file(kernel_file, tmp_path / name) for name in ("1.png", "2.png"))
    assert one.read_bytes() == two.read_bytes()


def test_an_existing_picture_is_kept_without_overwrite(kernel_file, tmp_path):
    out = tmp_path / "out.png"
    out.write_bytes(b"mine")
    with pytest.raises(OutputError, match="exists already"):
        render_file(kernel_file, out)
    assert out.read_bytes() == b"mine"
    render_file(kernel_file, out, overwrite=True)
    assert out.read_bytes().startswith(b"\x89PNG")


def test_pictures_are_png(kernel_file, tmp_path):
    with pytest.raises(OutputError, match="PNG"):
        render_file(kernel_file, tmp_path / "out.jpg")


def test_what_is_no_kernel_leaves_no_picture(tmp_path):
    (tmp_path / "k.npz").write_bytes(b"no zip")
    with pytest.raises(KernelFileError):
        render_file(tmp_path / "k.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["k.npz"]


def test_pictures_have_a_size_and_filters_rows_and_columns(kernels):
    kernel = kernels["flat"]
    for size in (0, -5):
        with pytest.raises(ValueError, match=f"a picture of {size} pixels"):
            render_kernel(kernel, size=size)
        with pytest.raises(ValueError, match=f"a picture of {size} pixels"):
            render_comparison({"one": kernel}, size=size)
        with pytest.raises(ValueError, match=f"a picture of {size} pixels"):
            render_filters(kernel, 2, 2, size=size)
    for rows, cols in ((0, 1), (2, -1)):
        with pytest.raises(ValueError, match=f"{rows} rows and {cols} columns"):
            render_filters(kernel, rows, cols)
