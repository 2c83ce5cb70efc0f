from __future__ import annotations

import numpy as np
import pytest

from deshake.estimation.edge_scale import EdgeScale
from deshake.estimation.latent_edges import contrast_scaled
from deshake.geometry.camera import Camera
from deshake.geometry.kernel import RotationKernel
from deshake.geometry.rotations import grid_steps
from deshake.operators.shake_blur import ShakeBlur

CUT = 0.015
LAM = 2e-3
MARGIN = 12


def at_work(
    sharp: np.ndarray, camera: Camera, path: np.ndarray
) -> tuple[EdgeScale, RotationKernel, RotationKernel]:
    """Shake a photo; return its scale, the true weights and ones that are spread."""
    true = RotationKernel.from_path(path * grid_steps(camera), camera)
    blurred = ShakeBlur(true, margin=MARGIN, kind="warps").forward(sharp)
    room = true.dilated((True, True, not camera.is_uniform))
    scale = EdgeScale(room, contrast_scaled(blurred)[0], None, 1)
    spread = RotationKernel(
        room.theta, 0.3 * room.weights + 0.7 / len(room.weights), room.steps, room.camera
    )
    return scale, room, spread


def off(kernel: RotationKernel, true: RotationKernel, sharp: np.ndarray) -> float:
    """Compare what two kernels make of a photo; neighbouring rotations make nearly the same."""
    blurs = [ShakeBlur(k, margin=MARGIN).forward(sharp) for k in (kernel, true)]
    return float(np.sqrt(np.square(blurs[0] - blurs[1]).mean()))


@pytest.mark.parametrize("uniform", [True, False], ids=["uniform", "rotational"])
def test_a_spread_kernel_is_brought_nearer_the_truth(sharp: np.ndarray, *, uniform: bool) -> None:
    shape = sharp.shape[0] - 2 * MARGIN, sharp.shape[1] - 2 * MARGIN
    camera = Camera.uniform(*shape) if uniform else Camera.from_focal(260.0, *shape)
    path = np.array([[0.0, -3, -2 * (not uniform)], [1, 0, 0], [-2, 3, 2 * (not uniform)]])
    scale, true, kernel = at_work(sharp, camera, path)
    before = off(kernel, true, sharp)
    for _ in range(4):
        kernel = scale.refined(kernel, scale.strong_edges(kernel, LAM), cut=CUT)
    assert off(kernel, true, sharp) < 0.8 * before
    assert kernel.weights.sum() == pytest.approx(1)
    np.testing.assert_array_equal(kernel.theta, true.theta)


def test_edges_are_worth_their_price_and_lie_inside(sharp: np.ndarray) -> None:
    camera = Camera.uniform(sharp.shape[0] - 2 * MARGIN, sharp.shape[1] - 2 * MARGIN)
    scale, kernel, _ = at_work(sharp, camera, np.array([[0.0, -3, 0], [0, 3, 0]]))
    across, down = scale.strong_edges(kernel, LAM)
    length = across**2 + down**2
    assert length[length > 0].min() >= np.float32(LAM)
    assert not length[scale.interior == 0].any()
    latent = scale.latent_gradients()
    assert latent.shape == (2, *camera.shape)
    margin = scale.seen.margin
    counted = length[margin:-margin, margin:-margin] > 0
    np.testing.assert_array_equal(
        latent[0][counted], across[margin:-margin, margin:-margin][counted]
    )
    shocked = scale.edges(kernel, LAM, shock=True)
    plain = scale.edges(kernel, LAM, shock=False)
    assert not np.array_equal(shocked[0], plain[0])


def test_no_edges_leave_the_kernel_as_it_was(sharp: np.ndarray) -> None:
    camera = Camera.uniform(sharp.shape[0] - 2 * MARGIN, sharp.shape[1] - 2 * MARGIN)
    scale, kernel, _ = at_work(sharp, camera, np.array([[0.0, -3, 0], [0, 3, 0]]))
    nothing = np.zeros_like(scale.interior)
    np.testing.assert_array_equal(
        scale.refined(kernel, (nothing, nothing), cut=CUT).weights, kernel.weights
    )
