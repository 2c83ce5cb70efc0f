from __future__ import annotations

import os
import subprocess
import sys
from threading import Thread

import numpy as np
import pytest
import scipy.linalg  # its library of linear algebra is another one than NumPy's
from threadpoolctl import threadpool_info, threadpool_limits

from deshake.api.linear_algebra import one_linear_thread


def threads() -> set[int]:
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def two_threads():
    assert scipy.linalg.det(np.eye(2)) == 1
    with threadpool_limits(2, user_api="blas"):
        if threads() != {2}:
            pytest.skip("the linear algebra of this machine cannot use two threads")
        yield


def test_the_limit_ends_with_the_call():
    with one_linear_thread():
        assert threads() == {1}
    assert threads() == {2}


def test_the_limit_ends_with_an_error():
    with pytest.raises(ValueError, match="bad"), one_linear_thread():
        raise ValueError("bad")
    assert threads() == {2}


def test_a_call_within_another_thread_does_not_lift_the_limit():
    def other() -> None:
        with one_linear_thread():
            pass

    with one_linear_thread():
        call = Thread(target=other)
        call.start()
        call.join()
        assert threads() == {1}
    assert threads() == {2}


PROGRAM = """
import numpy as np
import deshake
from threadpoolctl import threadpool_info

def threads():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}

seen = set()
def progress(share, text):
    seen.update(threads())

sharp = np.random.default_rng(0).random((12, 15)).repeat(10, 0).repeat(10, 1)
camera = deshake.Camera.from_focal(150.0, *sharp.shape)
shaken = deshake.simulate(sharp, camera, blur_px=6, seed=1)
kernel = deshake.estimate_blind(
    shaken.blurred, shaken.kernel.camera, blur_size=8, progress=progress
).kernel
deshake.deblur(shaken.blurred, kernel, quality="fast", progress=progress)
print(*seen, *threads())
"""


def test_the_functions_of_the_library_use_one_thread():
    free = {name: value for name, value in os.environ.items() if not name.endswith("NUM_THREADS")}
    two = free | {"OPENBLAS_NUM_THREADS": "2"}
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, env=two
    )
    assert result.stdout.split() == ["1", "2"]
