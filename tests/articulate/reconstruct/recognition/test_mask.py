"""Crops around the object of an image."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from articulate.errors import UsageError
from articulate.reconstruct.recognition.mask import WHITE, crop_on_white, crop_with_background

IMAGE = (np.arange(100 * 120).reshape(100, 120, 1) % 200).astype(np.uint8).repeat(3, axis=2)


def box(top: int, bottom: int, left: int, right: int) -> NDArray[np.bool_]:
    """Return a mask (100, 120) of a rectangle."""
    mask = np.zeros(IMAGE.shape[:2], dtype=np.bool_)
    mask[top:bottom, left:right] = True
    return mask


def test_margins_are_shares_of_the_larger_side() -> None:
    mask = box(30, 70, 20, 70)  # 40 by 50; 8 % of 50 is 4, 12 % is 6
    assert np.array_equal(crop_with_background(IMAGE, mask), IMAGE[24:76, 14:76])
    white = crop_on_white(IMAGE, mask)
    assert white.shape == (48, 58, 3)
    assert np.array_equal(white[4:-4, 4:-4], IMAGE[30:70, 20:70])
    assert (white[:4] == WHITE).all()


def test_the_crop_with_background_ends_at_the_image() -> None:
    assert np.array_equal(crop_with_background(IMAGE, box(0, 100, 0, 50)), IMAGE[:, :62])


def test_an_empty_mask_is_named() -> None:
    for crop in (crop_on_white, crop_with_background):
        with pytest.raises(UsageError, match="no object"):
            crop(IMAGE, box(0, 0, 0, 0))
