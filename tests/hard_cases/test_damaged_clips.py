# SPDX-License-Identifier: Apache-2.0
"""Clips of every kind of damage and of every odd format, through the frames stage: a result that tells, or a reason."""

from __future__ import annotations

import json
import random
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from killed_runs import FPS, N_FILMED, film_room

from cotton3dg import pipeline
from cotton3dg.errors import CaptureFailed, Cotton3dgError
from cotton3dg.io.images import read_image
from cotton3dg.io.video import ffmpeg_binary
from cotton3dg.workspace import Workspace

COUNT = 20


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """50 sound frames in 2.1 s, the index in front, a key frame every 8."""
    folder = tmp_path_factory.mktemp("film")
    film_room(folder / "film.mp4")
    small = ("-vf", "scale=240:180", "-crf", "10", "-g", "8")
    return encoded(folder / "film.mp4", folder / "whole.mp4", *small, "-movflags", "+faststart")


def encoded(source: Path, target: Path, *arguments: str) -> Path:
    command = [ffmpeg_binary(), "-v", "error", "-nostdin", "-i", str(source), *arguments, f"file:{target}"]
    subprocess.run(command, check=True)
    return target


def frames_of(clip: Path) -> tuple[Workspace, dict]:
    workspace = Workspace(clip.parent)
    options = pipeline.stage_options(workspace, overrides={"frames": {"count": COUNT, "max_side": 160}})
    pipeline.run(workspace, options, ("frames",))
    return workspace, json.loads(workspace.frames_json.read_text())


def decoded(clip: Path) -> np.ndarray:
    """(N_FILMED, 120, 160, 3) frames of a sound clip, as large as the stage saves them."""
    command = [ffmpeg_binary(), "-v", "error", "-i", str(clip), "-vf", "scale=160:120", "-f", "rawvideo"]
    done = subprocess.run([*command, "-pix_fmt", "rgb24", "pipe:1"], check=True, capture_output=True)
    return np.frombuffer(done.stdout, np.uint8).reshape(N_FILMED, 120, 160, 3)


def outcome(clip: Path) -> str:
    """Whether it was taken as sound, taken and flagged, or refused; always with a record, a reason and a remedy."""
    try:
        workspace, told = frames_of(clip)
    except Cotton3dgError as error:
        assert isinstance(error, CaptureFailed), error
        assert "; " in str(error)
        record = Workspace(clip.parent).read_record("frames")
        assert record.exit_code == 4
        assert not Workspace(clip.parent).folder("frames").exists()
        return "refused"
    record = workspace.read_record("frames")
    for path in workspace.frame_images():
        assert read_image(path).std() > 5, "a frame of nothing"
    assert len(workspace.frame_images()) == len(told["images"]) >= COUNT
    damaged = {"video_damaged", "blank_frames", "repeated_frames", "few_frames"} & set(record.flags)
    assert len(record.warnings) >= len(damaged)
    return "flagged" if damaged else "sound"


CUTS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 0.999)


@pytest.mark.parametrize("share", CUTS)
def test_case_39_a_clip_cut_off_anywhere_is_flagged_or_refused(whole: Path, tmp_path: Path, share: float) -> None:
    content = whole.read_bytes()
    (tmp_path / "cut.mp4").write_bytes(content[: int(len(content) * share)])
    assert outcome(tmp_path / "cut.mp4") in (("refused",) if share <= 0.7 else ("refused", "flagged"))


def rotten(content: bytes, kind: str, seed: int) -> bytes:
    rng, work = random.Random(seed), bytearray(content)
    start = content.index(b"mdat") + 8
    if kind == "bits":
        for _ in range(40):
            work[rng.randrange(start, len(work))] ^= 1 << rng.randrange(8)
    elif kind == "zeros":
        at = rng.randrange(start, len(work) - 3000)
        work[at : at + 3000] = bytes(3000)
    elif kind == "noise":
        at = rng.randrange(start, len(work) - 2000)
        work[at : at + 2000] = rng.randbytes(2000)
    elif kind == "missing":
        at = rng.randrange(start, len(work) - 1500)
        del work[at : at + 1500]
    else:  # in the index in front of the frames
        for _ in range(6):
            work[rng.randrange(40, start - 8)] = rng.randrange(256)
    return bytes(work)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["bits", "zeros", "noise", "missing", "index"])
def test_case_39_bit_rot_never_gives_frames_of_nothing(whole: Path, tmp_path: Path, kind: str, seed: int) -> None:
    """Rot of a few hundred bytes may pass unseen, but costs no more than the frames of the group that it hits."""
    (tmp_path / "rotten.mp4").write_bytes(rotten(whole.read_bytes(), kind, seed))
    if outcome(tmp_path / "rotten.mp4") == "refused":
        return
    workspace, filmed = Workspace(tmp_path), decoded(whole)
    taken = json.loads(workspace.frames_json.read_text())["images"]
    differences = [
        np.abs(read_image(path).astype(int) - filmed[min(entry["source_index"], N_FILMED - 1)]).mean()
        for path, entry in zip(workspace.frame_images(), taken, strict=True)
    ]
    # 6 grey levels are those of encoding and scaling.
    assert (np.array(differences) > 12).mean() <= 0.1


@pytest.mark.parametrize("kind", ["zeros", "noise"])
def test_case_39_rot_in_a_fifth_of_the_frames_is_never_taken_for_sound(whole: Path, tmp_path: Path, kind: str) -> None:
    content = whole.read_bytes()
    for seed in range(6):
        content = rotten(content, kind, seed)
    (tmp_path / "rotten.mp4").write_bytes(content)
    assert outcome(tmp_path / "rotten.mp4") in ("flagged", "refused")


FORMATS: dict[str, tuple[str, tuple[str, ...]]] = {
    "10 bit": ("a.mp4", ("-pix_fmt", "yuv420p10le", "-c:v", "libx265", "-x265-params", "log-level=none")),
    "10 bit 4:2:2": ("a.mkv", ("-pix_fmt", "yuv422p10le", "-c:v", "ffv1")),
    "full range": ("a.mp4", ("-vf", "scale=out_range=full", "-pix_fmt", "yuvj420p")),
    "motion JPEG": ("a.avi", ("-c:v", "mjpeg", "-q:v", "3")),
    "VP9": ("a.webm", ("-c:v", "libvpx-vp9", "-deadline", "realtime", "-cpu-used", "8")),
    "MPEG-4": ("a.avi", ("-c:v", "mpeg4", "-q:v", "3")),
    "open groups and B frames": ("a.mp4", ("-bf", "3", "-g", "250", "-x264-params", "open-gop=1")),
    "interlaced": ("a.mp4", ("-vf", "tinterlace=interleave_top,fps=24", "-flags", "+ilme+ildct")),
    "fragmented": ("a.mp4", ("-movflags", "frag_keyframe+empty_moov")),
    "variable rate": ("a.mkv", ("-vf", "settb=1/1000,setpts=40*(N+pow(N/10\\,2))", "-enc_time_base", "1/1000")),
    "negative start": ("a.mkv", ("-output_ts_offset", "-1",)),
    "late start": ("a.mp4", ("-output_ts_offset", "0.2")),
    "odd size": ("a.mkv", ("-vf", "crop=199:149", "-pix_fmt", "yuv444p")),
    "no square pixels": ("a.mp4", ("-vf", "setsar=4/3")),
    "with sound and cover": ("a.mkv", ("-f", "lavfi", "-i", "sine=d=2", "-shortest")),
    "mp4 that is mkv": ("a.mp4", ("-f", "matroska")),
    "mov that is avi": ("a.mov", ("-f", "avi", "-c:v", "mpeg4", "-q:v", "3")),
    "capitals": ("A.MP4", ()),
}  # fmt: skip


@pytest.mark.parametrize("name", list(FORMATS))
def test_case_40_to_42_odd_formats_are_read_as_they_are(whole: Path, tmp_path: Path, name: str) -> None:
    target, arguments = FORMATS[name]
    clip = encoded(whole, tmp_path / target, *arguments)
    assert outcome(clip) in ("sound", "flagged")
    times = [entry["timestamp_s"] for entry in json.loads(Workspace(tmp_path).frames_json.read_text())["images"]]
    assert (np.diff(times) > 0).all()
    if name == "variable rate":
        assert times[-1] - times[0] == pytest.approx(0.04 * (N_FILMED - 1 + 4.9**2), rel=0.2)
    elif name != "interlaced":
        assert times[-1] - times[0] == pytest.approx((N_FILMED - 1) / FPS, rel=0.2)


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_case_41_a_turned_clip_comes_out_upright(whole: Path, tmp_path: Path, degrees: int) -> None:
    """The same frames as from the clip without the tag, turned."""
    (tmp_path / "plain").mkdir()
    (tmp_path / "turned").mkdir()
    plain = encoded(whole, tmp_path / "plain" / "a.mp4", "-c", "copy")
    turned = tmp_path / "turned" / "a.mp4"
    described = subprocess.run([ffmpeg_binary(), "-h", "full"], capture_output=True, check=True).stdout
    tag = ("-display_rotation:v:0", str(-degrees)) if b"-display_rotation" in described else ()
    older = () if tag else ("-metadata:s:v:0", f"rotate={-degrees % 360}")
    command = [ffmpeg_binary(), "-v", "error", *tag, "-i", str(plain), "-c", "copy", *older]
    subprocess.run([*command, str(turned)], check=True)
    upright, told = frames_of(plain)
    rotated, same = frames_of(turned)
    assert same["video"]["rotation_deg"] == degrees
    taken = [[entry["source_index"] for entry in facts["images"]] for facts in (told, same)]
    index = next(index for index in taken[0] if index in taken[1])
    first = read_image(upright.frame_images()[taken[0].index(index)])
    back = np.rot90(read_image(rotated.frame_images()[taken[1].index(index)]), degrees // 90)
    assert back.shape == first.shape
    assert np.abs(back.astype(int) - first).mean() < 4


NOT_FILMS: dict[str, Callable[[bytes], bytes]] = {
    "nothing": lambda whole: b"",
    "one byte": lambda whole: whole[:1],
    "text": lambda whole: b"Dear Sir or Madam,\n" * 500,
    "zeros": lambda whole: bytes(100_000),
    "noise": lambda whole: random.Random(0).randbytes(100_000),
    "a photo": lambda whole: b"\xff\xd8\xff\xe0\0\x10JFIF" + whole[:5000],
    "an archive": lambda whole: b"PK\3\4" + whole[:5000],
    "a header alone": lambda whole: whole[: whole.index(b"mdat") + 4],
    "no index": lambda whole: whole[:32] + whole[whole.index(b"mdat") - 4 :],
    "upside down": lambda whole: whole[::-1],
    "a playlist": lambda whole: b"#EXTM3U\n#EXTINF:1,\nfile:/etc/passwd\n",
}


@pytest.mark.parametrize("name", list(NOT_FILMS))
def test_case_39_what_is_no_film_is_refused(whole: Path, tmp_path: Path, name: str) -> None:
    (tmp_path / "walk.mp4").write_bytes(NOT_FILMS[name](whole.read_bytes()))
    assert outcome(tmp_path / "walk.mp4") == "refused"


def test_case_39_a_film_without_pictures_is_refused(tmp_path: Path) -> None:
    command = [ffmpeg_binary(), "-v", "error", "-f", "lavfi", "-i", "sine=d=3", str(tmp_path / "sound.mp4")]
    subprocess.run(command, check=True)
    with pytest.raises(CaptureFailed, match=r"sound\.mp4 is not a video"):
        frames_of(tmp_path / "sound.mp4")
