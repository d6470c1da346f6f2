# SPDX-License-Identifier: Apache-2.0
"""Videos written through ffmpeg and read back."""

import cv2
import numpy as np
import pytest

from cotton3dg.errors import EnvironmentUnusable, OutOfResources, StageFailed
from cotton3dg.io import encode
from cotton3dg.io.encode import video_encoder
from cotton3dg.io.video import probe, read_frames


def frame(i: int) -> np.ndarray:
    """Smooth ramps of saturated colours that move with time."""
    y, x = np.mgrid[:48, :64]
    waves = [np.sin(x / 20 + i / 3), np.cos(y / 18 - i / 4), np.sin((x + y) / 30)]
    return np.rint(127.5 + 120 * np.stack(waves, axis=2)).astype(np.uint8)


@pytest.mark.parametrize("name", ["film.mp4", "-odd: name'.mp4"])
def test_what_is_written_is_read(tmp_path, name):
    path = tmp_path / name
    with video_encoder(path, 64, 48, 12.5, 4) as append:
        for i in range(20):
            append(frame(i))
    facts = probe(path)
    assert (facts.codec, facts.width, facts.height, facts.pixel_format) == ("h264", 64, 48, "yuv420p")
    assert facts.fps == 12.5 and facts.duration_s == pytest.approx(1.6)
    read = list(read_frames(path, facts, list(range(20)), 64))
    assert max(np.abs(read[i].astype(float) - frame(i)).mean() for i in range(20)) < 3
    video = cv2.VideoCapture(str(path))  # another reader understands the colours alike
    assert np.abs(video.read()[1][..., ::-1].astype(float) - frame(0)).mean() < 3


def test_a_frame_of_another_size_is_refused(tmp_path):
    with pytest.raises(ValueError, match="48, 64, 3"), video_encoder(tmp_path / "film.mp4", 64, 48, 30, 18) as append:
        append(frame(0)[:40])


def test_an_encoder_that_dies_is_explained(tmp_path):
    nowhere = video_encoder(tmp_path / "nowhere" / "film.mp4", 64, 48, 30, 18)
    with pytest.raises(StageFailed, match="could not encode"), nowhere as append:
        for i in range(1000):
            append(frame(i))
    with pytest.raises(StageFailed, match="could not encode"), video_encoder(tmp_path / "x.mp4", 63, 48, 30, 18):
        pass


@pytest.mark.parametrize(
    ("said", "kind"),
    [("av_interleaved_write_frame(): No space left on device", OutOfResources),
     ("Unknown encoder 'libx264'", EnvironmentUnusable),
     ("", StageFailed)],
)  # fmt: skip
def test_what_ffmpeg_says_is_told_with_a_remedy(said, kind):
    error = encode._failure(said)
    assert isinstance(error, kind) and "; " in str(error)
