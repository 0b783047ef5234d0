"""Colours as linear light: the transfer function against its definition."""

from __future__ import annotations

import numpy as np

from sacha_core.scene.colours import linear_colours

FLOAT32 = 1e-7  # relative: what storing in float32 costs


def test_srgb_is_decoded_as_its_standard_says() -> None:
    grey = np.arange(256, dtype=np.uint8)
    decoded = linear_colours(np.stack([grey] * 3, axis=1))
    expected = [v / 255 / 12.92 if v / 255 <= 0.04045 else ((v / 255 + 0.055) / 1.055) ** 2.4 for v in range(256)]
    assert decoded.dtype == np.float32
    assert np.allclose(decoded[:, :3], np.array(expected)[:, None], rtol=FLOAT32, atol=0)
    assert (decoded[:, 3] == 1).all()
