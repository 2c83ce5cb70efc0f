"""Separation of light and colour, which the eye and the statistics of photos treat differently.

An orthonormal reflection maps the grey axis to the first plane. That plane is light; the others
are colour differences. Edges are much weaker in these, so a prior may smooth them more: with
weight k in place of 1, the squared length of a vector x is

    |x|_k^2 = k^2 |x|^2 - (k^2 - 1) (u . x)^2,    u = (1, ..., 1) / sqrt(C).

A grey image, C = 1, has no colour.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["plane_weights", "reflect", "squared_lengths", "weigh_colour"]

Image = NDArray[np.float32]


def reflect(image: Image) -> None:
    """Exchange colours (C, ...) and light with colour differences, in place; its own inverse."""
    count = len(image)
    if count == 1:
        return
    # Householder's reflection along v = u - e_1, |v|^2 = 2 - 2 / sqrt(C)
    u = np.float32(count**-0.5)
    along = image.sum(0)
    along *= u
    along -= image[0]  # v . x
    along /= 1 - u
    image[0] += (1 - u) * along
    image[1:] -= u * along


def plane_weights(count: int, k: float) -> Image:
    """Return the squared weights of C planes of a reflected image, (C,)."""
    weights = np.full(count, k * k, np.float32)
    weights[0] = 1
    return weights


def squared_lengths(image: Image, k: float) -> Image:
    """Return |x|_k^2 of the vectors of an image (C, ...), (...)."""
    squares: Image = np.square(image).sum(0)
    if len(image) > 1:
        squares *= np.float32(k * k)
        squares -= np.float32((k * k - 1) / len(image)) * np.square(image.sum(0))
    return squares


def weigh_colour(image: Image, k: float) -> None:
    """Apply the matrix of |x|_k^2, ``k^2 - (k^2 - 1) u u^T``, to an image (C, ...), in place."""
    if len(image) > 1:
        light = image.sum(0)
        light *= np.float32((k * k - 1) / len(image))
        image *= np.float32(k * k)
        image -= light
