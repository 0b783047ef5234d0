"""Videos. Oracle: reading them back with PyAV."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest

from sacha_core.cli.video import write_video
from sacha_core.errors import OptionError

PIXEL_ERROR = 6.0  # mean, of 255: x264 at CRF 18 with halved colour resolution


def moving_bar(n_frames: int, height: int, width: int) -> Iterator[np.ndarray]:
    for frame in range(n_frames):
        image = np.full((height, width, 3), 255, np.uint8)
        image[:, 4 * frame : 4 * frame + 16] = (40, 90, 160)
        yield image


def test_frames_sizes_and_rate_come_back(tmp_path: Path) -> None:
    path = tmp_path / "out" / "a.mp4"
    write_video(path, moving_bar(10, 65, 97), 30.0)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.average_rate == 30
        images = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
    assert len(images) == 10
    assert images[0].shape == (66, 98, 3)
    for image, truth in zip(images, moving_bar(10, 65, 97), strict=True):
        assert np.abs(image[:65, :97].astype(float) - truth).mean() < PIXEL_ERROR
    assert [one.name for one in path.parent.iterdir()] == ["a.mp4"]


def test_an_unknown_container_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"\.mp4"):
        write_video(tmp_path / "a.txt", moving_bar(1, 8, 8), 25.0)
    assert not list(tmp_path.iterdir())


def test_a_failure_in_the_middle_leaves_nothing(tmp_path: Path) -> None:
    def broken() -> Iterator[np.ndarray]:
        yield from moving_bar(2, 16, 16)
        raise OSError("lost the disk")

    with pytest.raises(OSError, match="lost the disk"):
        write_video(tmp_path / "a.mp4", broken(), 25.0)
    assert not list(tmp_path.iterdir())
