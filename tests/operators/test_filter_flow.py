from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import displacements, grid_steps, homographies, reach
from deshake.operators import filter_flow
from deshake.operators.filter_flow import FilterFlow, patch_hop
from deshake.operators.local_filters import LocalFilters
from deshake.operators.warps import Warps
from deshake.run import Run


def rms(a: np.ndarray) -> float:
    return float(np.sqrt((a.astype(np.float64) ** 2).mean()))


def shake(camera: Camera, path: np.ndarray, extent: float) -> RotationKernel:
    """Scale a path until it moves pixels over `extent` in all."""
    size = 1e-3
    for _ in range(4):
        kernel = RotationKernel.from_path(path * size, camera)
        size *= extent / kernel.extent_px()
    return kernel


LINE = np.linspace(-0.5, 0.5, 7)[:, None]
ARC = np.stack([LINE[:, 0] ** 2 - 0.1, LINE[:, 0], 0.6 * np.sin(4 * LINE[:, 0])], 1)
SHAKES = {
    "x": LINE * [1, 0, 0],
    "y": LINE * [0, 1, 0],
    "z": LINE * [0, 0, 1],
    "all": LINE * [0.7, -1, 1],
    "curved": ARC,
}


@pytest.mark.parametrize(
    ("name", "extent"), [("x", 10), ("y", 30), ("z", 30), ("all", 16), ("curved", 30)]
)
def test_blur_is_within_a_thousandth_of_exact_warps(
    photo: np.ndarray, name: str, extent: int
) -> None:
    camera = Camera.from_focal(512.0, 384, 512)
    kernel = shake(camera, SHAKES[name], extent)
    assert kernel.extent_px() == pytest.approx(extent, rel=0.1)
    exact, flow = Warps(camera, kernel.theta), FilterFlow(camera, kernel.theta)
    middle = photo[192:576, 256:768]  # of it all four photographs have a quarter
    f = np.pad(middle, exact.margin, mode="reflect")
    expected = exact.blur(f, kernel.weights)
    assert rms(expected - middle) > 0.02
    error = rms(flow.blur(f, kernel.weights) - expected)
    assert error < 1e-3
    rough = FilterFlow(camera, kernel.theta, rough=True)
    assert error < rms(rough.blur(f, kernel.weights) - expected) < 3e-3


@given(
    height=st.integers(1, 90),
    width=st.integers(1, 90),
    hop=st.integers(2, 40),
    rough=st.booleans(),
    margin=st.integers(0, 25),
    size=st.floats(0, 8),
    seed=st.integers(0, 1000),
)
@settings(max_examples=40, deadline=None, derandomize=True)
def test_adjoint_of_any_frame(
    *, height: int, width: int, hop: int, rough: bool, margin: int, size: float, seed: int
) -> None:
    camera = Camera.from_focal(80.0, height, width)
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(4, 3)) * size * grid_steps(camera)
    theta = np.clip(theta, -0.2, 0.2)
    flow = FilterFlow(camera, theta, margin=margin, hop=hop, rough=rough, run=Run(2))
    f = rng.random(flow.latent_shape).astype(np.float32)
    g, w = rng.random(camera.shape).astype(np.float32), rng.random(4)
    blurred = flow.blur(f, w).astype(np.float64)
    # against the operator's norm: a frame of one pixel may see nothing but the FFTs' rounding
    scale = np.linalg.norm(f) * np.linalg.norm(g) * w.sum()
    assert abs(np.vdot(blurred, g) - np.vdot(f, flow.adjoint(g, w))) <= 2e-6 * scale
    assert abs(np.vdot(blurred, g) - flow.kernel_adjoint(f, g) @ w) <= 2e-6 * scale


@pytest.mark.parametrize("kind", [FilterFlow, Warps])
def test_blur_is_linear_in_image_and_kernel(
    kind: type, camera: Camera, theta: np.ndarray, weights: np.ndarray
) -> None:
    model = kind(camera, theta)
    rng = np.random.default_rng(0)
    f, other = rng.random((2, *model.latent_shape)).astype(np.float32)
    w = rng.random(len(theta))
    a = model.blur(f, weights)
    combined = model.blur(2 * f - 3 * other, weights)
    np.testing.assert_allclose(combined, 2 * a - 3 * model.blur(other, weights), atol=2e-5)
    combined = model.blur(f, 2 * weights - 3 * w)
    np.testing.assert_allclose(combined, 2 * a - 3 * model.blur(f, w), atol=5e-5)


@pytest.mark.parametrize("kind", [FilterFlow, Warps])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_constants_are_kept(
    kind: type, camera: Camera, theta: np.ndarray, weights: np.ndarray, channels: tuple[int, ...]
) -> None:
    model = kind(camera, theta)
    flat = np.full((*model.latent_shape, *channels), 0.7, np.float32)
    np.testing.assert_allclose(model.blur(flat, weights), 0.7, atol=2e-6)


def test_colours_are_blurred_alike(camera: Camera, theta: np.ndarray, weights: np.ndarray) -> None:
    flow = FilterFlow(camera, theta, channels=3)
    rng = np.random.default_rng(0)
    f = rng.random((*flow.latent_shape, 3)).astype(np.float32)
    r = rng.random((*camera.shape, 3)).astype(np.float32)
    planes = [flow.blur(f[..., c], weights) for c in range(3)]
    np.testing.assert_allclose(flow.blur(f, weights), np.stack(planes, -1), atol=1e-6)
    summed = sum(flow.kernel_adjoint(f[..., c], r[..., c]) for c in range(3))
    np.testing.assert_allclose(flow.kernel_adjoint(f, r), summed, rtol=1e-5)


def test_bytes_do_not_depend_on_the_threads() -> None:
    camera = Camera.from_focal(300.0, 211, 307)
    theta = np.random.default_rng(0).normal(size=(40, 3)) * 4 * grid_steps(camera)
    w = np.full(40, 1 / 40)
    rng = np.random.default_rng(1)
    results = []
    for threads in (1, 2, 4):
        flow = FilterFlow(camera, theta, margin=9, hop=24, run=Run(threads))
        rng = np.random.default_rng(1)
        f = rng.random((*flow.latent_shape, 3)).astype(np.float32)
        g = rng.random((*camera.shape, 3)).astype(np.float32)
        maps = (
            flow.blur(f, w),
            flow.adjoint(g, w),
            flow.kernel_adjoint(f, g),
            flow.gram(g, g[..., 0]),
        )
        assert len(flow.grid.strips) > 4
        results.append([np.ascontiguousarray(part).tobytes() for part in maps])
    assert results[0] == results[1] == results[2]


def test_nothing_depends_on_what_is_kept(
    camera: Camera, theta: np.ndarray, weights: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    def all_maps(budget: int) -> list[bytes]:
        flow = FilterFlow(camera, theta)
        rng = np.random.default_rng(0)
        f = rng.random(flow.latent_shape).astype(np.float32)
        g = rng.random(camera.shape).astype(np.float32)
        filters = LocalFilters(flow.grid, flow.filters(weights).filters, budget=budget)
        maps = [filters.forward(f[None]), filters.forward(f[None]), flow.kernel_adjoint(f, g)]
        return [part.tobytes() for part in maps]

    kept = all_maps(1 << 30)
    monkeypatch.setattr(filter_flow, "_TAPS_KEPT", 0)
    assert all_maps(0) == kept


def test_gram_is_close_to_exact_on_a_photo(photo: np.ndarray) -> None:
    """Gradients of a photo are the hard case: what an estimate works on."""
    height, width = 192, 256
    small = cv2.resize(photo[:384, :512], (width, height), interpolation=cv2.INTER_AREA)
    along = [np.diff(small, axis=a, append=0)[: height - 1, : width - 1] for a in (1, 0)]
    f = np.ascontiguousarray(np.stack(along, -1))
    camera = Camera.from_focal(width, height - 1, width - 1)
    indices = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3), -1).reshape(-1, 3)
    theta = indices * grid_steps(camera)
    mask = np.zeros(camera.shape, np.float32)
    mask[6:-6, 6:-6] = 1
    exact = Warps(camera, theta, margin=0).gram(f, mask)
    near = FilterFlow(camera, theta, margin=0, hop=24).gram(f, mask)
    assert np.linalg.norm(near - exact) <= 0.1 * np.linalg.norm(exact)
    np.testing.assert_array_equal(near, near.T)
    spectrum = np.linalg.eigvalsh(near)
    assert spectrum[0] >= -1e-6 * spectrum[-1]


def test_gram_of_scattered_and_of_dense_rotations_agree(photo: np.ndarray) -> None:
    """Places of taps are gathered one by one or as a box: the same sums."""
    f = np.ascontiguousarray(photo[:90, 380:500])
    camera = Camera.from_focal(120.0, 90, 120)
    far = np.array([[0, -9, 0], [8, 3, 0], [0, 10, 1], [-9, 0, 0]])
    near = np.stack(np.meshgrid(*[np.arange(-4, 5)] * 2, 0), -1).reshape(-1, 3)
    steps = grid_steps(camera)
    some = FilterFlow(camera, far * steps, margin=0, hop=24).gram(f)
    every = np.concatenate([near * 2, far]) * steps
    both = FilterFlow(camera, every, margin=0, hop=24).gram(f)[-4:, -4:]
    np.testing.assert_allclose(both, some, rtol=1e-4)


def test_variance_term_is_the_sum_over_bilinear_weights() -> None:
    """Through a long lens the patches' displacements are exact, so this is too."""
    camera = Camera.uniform(12, 15)
    rng = np.random.default_rng(0)
    theta = rng.normal(size=(5, 3)) * [2, 2, 0] / camera.focal_px
    flow = FilterFlow(camera, theta, hop=6)
    exact = Warps(camera, theta)
    size = int(np.prod(exact.latent_shape))
    units = np.eye(size, dtype=np.float32).reshape(*exact.latent_shape, size)
    c = np.stack([exact.blur(units, unit).reshape(-1, size) for unit in np.eye(5)], -1)
    mask = rng.random(camera.shape).astype(np.float32)
    variance = rng.random(exact.latent_shape).astype(np.float32)
    expected = np.einsum("i,ijk,ijl,j->kl", mask.ravel(), c, c, variance.ravel())
    f = rng.random(camera.shape).astype(np.float32)
    difference = flow.gram(f, mask, variance) - flow.gram(f, mask)
    np.testing.assert_allclose(difference, expected, rtol=2e-3)
    # two channels of equal variance count twice
    twice = flow.gram(np.stack([f, f], -1), mask, np.stack([variance, variance], -1))
    np.testing.assert_allclose(twice, 2 * flow.gram(f, mask, variance), rtol=1e-4)


def test_variance_term_of_turning_patches() -> None:
    camera = Camera.from_focal(20.0, 14, 18)
    rng = np.random.default_rng(0)
    theta = rng.normal(size=(4, 3)) * 1.5 * grid_steps(camera)
    flow, exact = FilterFlow(camera, theta, hop=4), Warps(camera, theta)
    size = int(np.prod(exact.latent_shape))
    units = np.eye(size, dtype=np.float32).reshape(*exact.latent_shape, size)
    c = np.stack([exact.blur(units, unit).reshape(-1, size) for unit in np.eye(4)], -1)
    variance = rng.random(exact.latent_shape).astype(np.float32)
    expected = np.einsum("ijk,ijl,j->kl", c, c, variance.ravel())
    f = np.zeros(camera.shape, np.float32)
    gram = flow.gram(f, None, variance)
    assert np.linalg.norm(gram - expected) <= 0.1 * np.linalg.norm(expected)


def test_squared_filters_sum_the_squared_weights() -> None:
    camera = Camera.uniform(9, 11)
    theta = np.array([[0.0, 1.5, 0.0], [0.0, -0.25, 0.0]]) / camera.focal_px
    flow = FilterFlow(camera, theta)
    strip = flow.grid.strips[0]
    middle = flow.grid.radius
    row = flow.filters([2.0, 1.0], power=2).filters(strip)[0, middle]
    expected = np.zeros(flow.grid.reach)
    expected[middle + 1 : middle + 3] = 2 * 0.25
    expected[middle - 1 : middle + 1] = [0.0625, 0.5625]
    np.testing.assert_allclose(row, expected, atol=1e-3)


def test_reach_bounds_every_displacement(camera: Camera, theta: np.ndarray) -> None:
    y, x = np.mgrid[0 : camera.height, 0 : camera.width]
    points = np.stack([x.ravel(), y.ravel()], 1)
    largest = np.abs(displacements(homographies(camera, theta), points)).max()
    assert largest <= reach(camera, theta) <= largest + 2


def test_hop_is_short_where_displacements_change_fast() -> None:
    camera = Camera.from_focal(1024.0, 768, 1024)
    line = np.linspace(-1, 1, 21)[:, None]
    pan = patch_hop(camera, line * [0, 0.02, 0])
    roll = patch_hop(camera, line * [0, 0, 0.02])
    assert roll < pan
    assert patch_hop(camera, line * [0, 0, 0.04]) < roll
    # a turn that all rotations share changes displacements, too
    assert patch_hop(camera, line * [0, 0.02, 0] + np.array([0, 0, 0.05])) < pan


@pytest.mark.parametrize("shape", [(60, 80), (500, 700), (1500, 2000)])
@pytest.mark.parametrize("extent", [0.0, 30.0, 300.0])
def test_hop_is_cheap_where_displacements_agree(shape: tuple[int, int], extent: float) -> None:
    camera = Camera.uniform(*shape)
    theta = np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]) * extent / camera.focal_px
    grids = [FilterFlow(camera, theta, hop=hop).grid for hop in (None, 12, 24, 48, 96, 128, 192)]
    chosen, *others = (grid.rows * grid.columns * grid.block**2 for grid in grids)
    assert chosen <= 1.3 * min(others) + 4096 * grids[0].rows * grids[0].columns
    assert grids[0].block <= 640


def test_rough_filters_transform_less_than_half_of_the_pixels() -> None:
    camera = Camera.from_focal(3300.0, 2828, 4242)
    theta = np.linspace(-0.5, 0.5, 21)[:, None] * [0.004, 0.008, 0.001]
    exact, rough = (FilterFlow(camera, theta, rough=rough).grid for rough in (False, True))
    assert exact.ramp == exact.hop
    assert 3 * rough.ramp <= rough.hop < 3 * rough.ramp + 3
    pixels = [grid.rows * grid.columns * grid.block**2 for grid in (exact, rough)]
    assert pixels[1] < 0.5 * pixels[0]


def test_blocks_of_a_very_wide_blur_with_much_roll_are_few() -> None:
    camera = Camera.from_focal(1700.0, 1360, 2206)
    wide = np.linspace(-0.06, 0.06, 200)[:, None] * [0.3, 1, 0.8]
    grid = FilterFlow(camera, wide).grid
    assert grid.radius > 100
    assert grid.block**2 <= 30 * grid.patch**2


def test_wrong_input_is_refused(camera: Camera, theta: np.ndarray, weights: np.ndarray) -> None:
    flow = FilterFlow(camera, theta)
    latent = np.zeros(flow.latent_shape, np.float32)
    observed = np.zeros(camera.shape, np.float32)
    for wrong in (
        lambda: flow.blur(observed, weights),
        lambda: flow.adjoint(latent, weights),
        lambda: flow.kernel_adjoint(observed, observed),
        lambda: flow.kernel_adjoint(latent, latent),
        lambda: flow.gram(latent),
        lambda: flow.blur(latent, weights[:-1]),
        lambda: FilterFlow(camera, np.zeros(3)),
        lambda: FilterFlow(camera, np.zeros((0, 3))),
        lambda: FilterFlow(camera, np.full((2, 3), np.inf)),
    ):
        with pytest.raises(ValueError, match=r"fit|rotations are"):
            wrong()
