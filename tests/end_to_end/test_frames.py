# SPDX-License-Identifier: Apache-2.0
"""The frames stage on clips and photos, good and bad, through the pipeline."""

import json
import shutil
import subprocess

import cv2
import numpy as np
import pytest

from cotton3dg import pipeline
from cotton3dg.errors import CaptureFailed, MissingInput
from cotton3dg.frames import stage as frames
from cotton3dg.io import video
from cotton3dg.io.images import read_image
from cotton3dg.options import FramesOptions
from cotton3dg.staleness import stale_reason
from cotton3dg.workspace import Workspace

WIDTH, HEIGHT = 192, 108


def panorama(seed=0):
    """(HEIGHT, 1200, 3) coloured blobs to pan over."""
    rng = np.random.default_rng(seed)
    layers = [cv2.resize(rng.random((HEIGHT // s, 1200 // s, 3), np.float32), (1200, HEIGHT)) for s in (3, 12, 36)]
    return (np.mean(layers, axis=0) * 255).astype(np.uint8)


def pan(n_frames, step=4):
    wide = panorama()
    return [np.ascontiguousarray(wide[:, step * n : step * n + WIDTH]) for n in range(n_frames)]


def film(path, frames, *arguments, rate=25):
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-r", str(rate)]
    command += ["-s", f"{WIDTH}x{HEIGHT}", "-i", "pipe:0", "-pix_fmt", "yuv420p", "-g", "10", "-crf", "10"]
    subprocess.run([*command, *arguments, str(path)], input=b"".join(f.tobytes() for f in frames), check=True)
    return path


def run_frames(root, **values):
    workspace = Workspace(root)
    pipeline.run(workspace, pipeline.stage_options(workspace, overrides={"frames": values}), ("frames",))
    return workspace, json.loads(workspace.frames_json.read_text()), workspace.read_record("frames")


def test_the_sharp_frames_of_a_clip_are_taken(tmp_path):
    """Of every four frames three are blurred."""
    pictures = [f if n % 4 == 2 else cv2.blur(f, (9, 9)) for n, f in enumerate(pan(100))]
    film(tmp_path / "video.mp4", pictures)
    workspace, told, record = run_frames(tmp_path, count=25)
    taken = [entry["source_index"] for entry in told["images"]]
    assert len(taken) == 25 == len(workspace.frame_images())
    assert sum(index % 4 == 2 for index in taken) >= 23
    for entry in told["images"]:
        assert entry["timestamp_s"] == pytest.approx(entry["source_index"] / 25, abs=1e-3)
    saved = read_image(workspace.frame_images()[3]).astype(int)
    assert np.abs(saved - pictures[taken[3]]).mean() < 6
    assert (told["video"]["n_decoded"], told["video"]["n_intact"]) == (100, 100)
    assert record.flags == ()


def test_progress_goes_evenly_through_reading_and_saving(tmp_path):
    film(tmp_path / "video.mp4", pan(60))
    told = []
    frames.run(Workspace(tmp_path), FramesOptions(count=20), lambda *what: told.append(what))
    shares = [done / total for done, total, _ in told]
    assert shares == sorted(shares) and shares[-1] == 1
    assert shares[59] == pytest.approx(60 / 78) and {remark for *_, remark in told[60:]} == {"saving frames"}


def test_a_second_run_has_nothing_to_do_and_the_same_bytes(tmp_path):
    film(tmp_path / "video.mp4", pan(60))
    workspace, _, record = run_frames(tmp_path, count=20)
    options = pipeline.stage_options(workspace, overrides={"frames": {"count": 20}})
    assert stale_reason(workspace, "frames", options["frames"]) == ""
    pipeline.run(workspace, options, ("frames",), force=True)
    assert workspace.read_record("frames").outputs == record.outputs


def test_photos_beside_the_video_are_told(tmp_path):
    film(tmp_path / "video.mp4", pan(60))
    (tmp_path / "images").mkdir()
    for name in ("label.jpg", "images/1.png", "images/notes.txt"):
        (tmp_path / name).touch()
    _, _, record = run_frames(tmp_path, count=20)
    assert record.warnings[-1].startswith("2 photos beside video.mp4, e.g. label.jpg, are not used; to use photos, put")


def test_fewer_frames_than_wanted_are_all_used_and_told(tmp_path):
    film(tmp_path / "video.mp4", pan(30), rate=10)
    _, told, record = run_frames(tmp_path, count=100)
    assert [entry["source_index"] for entry in told["images"]] == list(range(30))
    assert record.flags == ("few_frames",)
    assert "30 frames instead of 100" in record.warnings[0]


@pytest.mark.parametrize(("n_frames", "rate"), [(19, 5), (40, 25), (1, 25)])
def test_short_clips_are_refused(tmp_path, n_frames, rate):
    film(tmp_path / "video.mp4", pan(n_frames), rate=rate)
    with pytest.raises(CaptureFailed, match="too short"):
        run_frames(tmp_path)
    assert not (tmp_path / "frames").exists()


def test_still_camera_is_refused(tmp_path):
    rng = np.random.default_rng(0)
    picture = panorama()[:, :WIDTH].astype(int)
    noisy = [(picture + rng.integers(-6, 7, picture.shape)).clip(0, 255).astype(np.uint8) for _ in range(60)]
    film(tmp_path / "video.mp4", noisy)
    with pytest.raises(CaptureFailed, match="stands still"):
        run_frames(tmp_path, count=30)


def test_half_of_a_clip_is_refused_and_most_of_it_flagged(tmp_path):
    film(tmp_path / "video.mp4", pan(200), "-movflags", "+faststart")
    content = (tmp_path / "video.mp4").read_bytes()
    (tmp_path / "video.mp4").write_bytes(content[: len(content) // 2])
    with pytest.raises(CaptureFailed, match=r"video\.mp4 is damaged: .* intact frames"):
        run_frames(tmp_path, count=20)
    (tmp_path / "video.mp4").write_bytes(content[: len(content) * 95 // 100])
    _, told, record = run_frames(tmp_path, count=20)
    assert record.flags == ("video_damaged",)
    assert told["video"]["n_intact"] < 200


@pytest.mark.parametrize(
    ("change", "flag"),
    [
        (lambda f: cv2.GaussianBlur(f, (0, 0), 4), "blurred"),
        (lambda f: f // 16, "underexposed"),
        (lambda f: np.minimum(f.astype(int) * 4, 255).astype(np.uint8), "overexposed"),
    ],
)
def test_poor_captures_are_flagged(tmp_path, change, flag):
    film(tmp_path / "video.mp4", [change(f) for f in pan(60)])
    _, _, record = run_frames(tmp_path, count=20)
    assert flag in record.flags
    assert len(record.warnings) == len(record.flags)


def photos(root, pictures, suffix=".jpg"):
    (root / "images").mkdir()
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(root / "images" / f"IMG_{number + 1}{suffix}"), picture[..., ::-1])


def test_photos_in_natural_order_and_smaller(tmp_path):
    pictures = [cv2.resize(f, (400, 225)) for f in pan(12, step=20)]
    photos(tmp_path, pictures, ".png")
    workspace, told, record = run_frames(tmp_path, max_side=200)
    assert [entry["file"] for entry in told["images"]] == [f"IMG_{n}.png" for n in range(1, 13)]
    assert told["ordered"] is False
    for path, picture in zip(workspace.frame_images(), pictures, strict=True):
        saved = read_image(path)
        assert saved.shape == (112, 200, 3)
        assert np.abs(saved.astype(int) - cv2.resize(picture, (200, 112), interpolation=cv2.INTER_AREA)).mean() < 3
    assert record.flags == ()


def test_photo_of_another_size_is_named(tmp_path):
    pictures = pan(12, step=20)
    pictures[7] = np.ascontiguousarray(np.rot90(pictures[7]))
    photos(tmp_path, pictures)
    with pytest.raises(CaptureFailed, match=r"IMG_8\.jpg is 108 x 192 px, those before are 192 x 108"):
        run_frames(tmp_path)


def test_truncated_photo_is_named(tmp_path):
    photos(tmp_path, pan(12, step=20))
    path = tmp_path / "images" / "IMG_5.jpg"
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(CaptureFailed, match=r"IMG_5\.jpg is cut off"):
        run_frames(tmp_path)


def test_too_few_photos(tmp_path):
    photos(tmp_path, pan(5))
    with pytest.raises(CaptureFailed, match="5 photos"):
        run_frames(tmp_path)


def test_photos_of_another_format_are_named(tmp_path):
    """A folder of an iPhone's photos had "0 photos"; those among JPEGs were left out in silence."""
    (tmp_path / "images").mkdir()
    for number in range(1, 4):
        (tmp_path / "images" / f"IMG_{number}.HEIC").write_bytes(b"\0\0\0\x18ftypheic")
    remedy = r"convert them to JPEG, e\.g\. with ImageMagick: magick mogrify -format jpg '\*\.HEIC'"
    with pytest.raises(
        CaptureFailed, match=rf"0 photos .*3 of a format that is not read, e\.g\. IMG_1\.HEIC; {remedy}"
    ):
        run_frames(tmp_path)
    shutil.rmtree(tmp_path / "images")
    photos(tmp_path, pan(12, step=20))
    for number in (3, 13, 14):  # the third was converted
        (tmp_path / "images" / f"IMG_{number}.HEIC").write_bytes(b"\0\0\0\x18ftypheic")
    _, told, record = run_frames(tmp_path)
    assert len(told["images"]) == 12
    assert "2 photos are left out, e.g. IMG_13.HEIC" in record.warnings[0]


def test_colours_below_transparent_parts_are_said(tmp_path):
    pictures = pan(9, step=20)
    photos(tmp_path, [np.dstack([np.full(p.shape[:2], 255, np.uint8), p]) for p in pictures], ".png")
    assert run_frames(tmp_path)[2].warnings == ()
    for path in (tmp_path / "images").iterdir():
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        pixels[:20, :, 3] = 0
        cv2.imwrite(str(path), pixels)
    assert "transparent parts, e.g. IMG_1.png" in run_frames(tmp_path)[2].warnings[0]


def test_empty_folder_and_no_video(tmp_path):
    with pytest.raises(MissingInput, match="photos of it into a folder named images"):
        run_frames(tmp_path)
    (tmp_path / "clip.mov").write_bytes(b"not a video")
    with pytest.raises(CaptureFailed, match=r"clip\.mov is not a video"):
        run_frames(tmp_path)


def test_failure_leaves_the_earlier_result(tmp_path):
    film(tmp_path / "video.mp4", pan(60))
    workspace, _, _ = run_frames(tmp_path, count=20)
    (tmp_path / "video.mp4").write_bytes(b"overwritten")
    with pytest.raises(CaptureFailed):
        run_frames(tmp_path, count=20)
    assert len(workspace.frame_images()) == 20
