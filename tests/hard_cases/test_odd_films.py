# SPDX-License-Identifier: Apache-2.0
"""Sound films in odd containers: what a demuxer says while it opens one is no damage, and the film in it is found."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from cotton3dg.errors import BadInput
from cotton3dg.frames.frame_statistics import Taken
from cotton3dg.frames.take_video import take_video
from cotton3dg.io import video
from cotton3dg.io.ffmpeg_text import parse_description, parse_log
from cotton3dg.options import FramesOptions

N_FILMED = 50
CHAPTERS = ";FFMETADATA1\n" + "".join(
    f"[CHAPTER]\nTIMEBASE=1/1000\nSTART={start}\nEND={start + 1000}\ntitle=[error] {start}\n" for start in (0, 1000)
)


def ffmpeg(*arguments: str | Path) -> None:
    subprocess.run([video.ffmpeg_binary(), "-v", "error", "-nostdin", "-y", *map(str, arguments)], check=True)


@pytest.fixture(scope="module", params=[30, 250])
def film(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """50 frames in 2.1 s along a wall of blots, with a key frame every so many."""
    path = tmp_path_factory.mktemp("film") / "film.mp4"
    blots = np.random.default_rng(0).integers(0, 256, (30, 80, 3), np.uint8)
    wall = np.kron(blots, np.ones((6, 6, 1), np.uint8))
    frames = b"".join(wall[:, 4 * number : 4 * number + 240].tobytes() for number in range(N_FILMED))
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "240x180", "-r", "24"]
    command += ["-i", "-", "-crf", "10", "-g", str(request.param), "-pix_fmt", "yuv420p", str(path)]
    subprocess.run(command, input=frames, check=True)
    return path


@pytest.fixture(scope="module")
def thumbnail(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("thumbnail") / "thumbnail.jpg"
    ffmpeg("-f", "lavfi", "-i", "testsrc=s=640x480", "-frames:v", "1", path)
    return path


def taken(path: Path) -> Taken:
    return take_video(path, FramesOptions(count=20, max_side=160), lambda *_: None, lambda *_: None, path.parent)


def assert_sound(found: Taken) -> None:
    assert found.info.video is not None
    assert (found.info.video.n_decoded, found.info.video.n_intact) == (N_FILMED, N_FILMED)
    assert (found.flags, found.warnings) == ((), ())


def test_a_chapter_track_that_is_not_there_costs_no_frame(film: Path, tmp_path: Path) -> None:
    (tmp_path / "chapters.txt").write_text(CHAPTERS)
    clip = tmp_path / "clip.mov"
    ffmpeg("-i", film, "-i", tmp_path / "chapters.txt", "-map_chapters", "1", "-map", "0:v", "-c", "copy", clip)
    content = bytearray(clip.read_bytes())
    at = content.index(b"chap") + 4
    content[at : at + 4] = (99).to_bytes(4, "big")
    clip.write_bytes(content)
    command = [video.ffmpeg_binary(), "-v", "error", "-i", str(clip), "-f", "null", "-"]
    assert b"chapter track not found" in subprocess.run(command, check=True, capture_output=True).stderr
    assert_sound(taken(clip))


def test_what_the_titles_of_a_film_say_is_no_damage(film: Path, tmp_path: Path) -> None:
    clip = tmp_path / "clip.mkv"
    title = "title=[error] corrupt decoded frame [fatal] x"
    ffmpeg("-i", film, "-metadata", title, "-metadata:s:v", title, "-c", "copy", clip)
    assert_sound(taken(clip))


def test_a_film_cut_without_encoding_keeps_its_frames(film: Path, tmp_path: Path) -> None:
    """An edit list hides the frames from the key frame to the cut."""
    clip = tmp_path / "clip.mov"
    ffmpeg("-stream_loop", "1", "-i", film, "-g", "250", tmp_path / "long.mp4")
    ffmpeg("-ss", "1", "-i", tmp_path / "long.mp4", "-c", "copy", clip)
    found = taken(clip)
    assert found.info.video is not None
    assert found.info.video.n_intact == found.info.video.n_decoded == 2 * N_FILMED - 24
    assert found.flags == ()


def test_a_film_without_a_length_in_its_header(film: Path, tmp_path: Path) -> None:
    command = [video.ffmpeg_binary(), "-v", "error", "-i", str(film), "-c", "copy", "-f", "matroska", "-live", "1", "-"]
    clip = tmp_path / "clip.mkv"
    clip.write_bytes(subprocess.run(command, check=True, capture_output=True).stdout)
    assert np.isnan(video.probe(clip).duration_s)
    assert_sound(taken(clip))


@pytest.mark.parametrize("name", ["clip.mp4", "clip.mkv"])
def test_a_thumbnail_before_the_film_is_not_the_film(film: Path, thumbnail: Path, tmp_path: Path, name: str) -> None:
    clip = tmp_path / name
    ffmpeg("-i", thumbnail, "-i", film, "-map", "0:v", "-map", "1:v", "-disposition:v:0", "default", "-c", "copy", clip)
    facts = video.probe(clip)
    assert (facts.stream, facts.codec, facts.width, facts.rivals) == (1, "h264", 240, 0)
    assert_sound(taken(clip))


def test_a_cover_picture_is_not_the_film(film: Path, thumbnail: Path, tmp_path: Path) -> None:
    clip = tmp_path / "clip.mp4"
    cover = ("-c", "copy", "-disposition:v:0", "attached_pic")
    ffmpeg("-i", thumbnail, "-i", film, "-map", "0:v", "-map", "1:v", *cover, clip)
    assert video.probe(clip).codec == "h264"
    assert_sound(taken(clip))


def test_of_two_films_the_one_that_players_show_is_taken_and_said(film: Path, tmp_path: Path) -> None:
    clip = tmp_path / "clip.mkv"
    ffmpeg(
        *("-i", film, "-i", film, "-map", "0:v", "-map", "1:v", "-c:v:0", "copy", "-s:v:1", "120x90"),
        *("-disposition:v:0", "0", "-disposition:v:1", "default", clip),
    )
    found = taken(clip)
    assert video.probe(clip).stream == 1
    assert found.flags == ()
    assert found.warnings == ("clip.mkv holds 2 films; stream 1 is taken (120 x 90 px)",)


def test_a_change_of_size_is_called_so(film: Path, tmp_path: Path) -> None:
    ffmpeg("-i", film, "-c", "copy", tmp_path / "a.ts")
    ffmpeg("-i", film, "-c:v", "libx264", "-s", "120x90", tmp_path / "b.ts")
    (tmp_path / "parts.txt").write_text("file a.ts\nfile b.ts\n")
    ffmpeg("-f", "concat", "-i", tmp_path / "parts.txt", "-c", "copy", tmp_path / "clip.mkv")
    with pytest.raises(BadInput, match=r"clip\.mkv changes its size from 240x180 to 120x90 px; "):
        taken(tmp_path / "clip.mkv")


def test_sound_alone_and_a_photo_are_no_films(thumbnail: Path, tmp_path: Path) -> None:
    ffmpeg("-f", "lavfi", "-i", "sine=d=3", tmp_path / "sound.mp4")
    (tmp_path / "photo.mp4").write_bytes(thumbnail.read_bytes())
    (tmp_path / "empty.mp4").touch()
    for name, why in (("sound", "is not a video"), ("photo", "is not a video"), ("empty", "is empty")):
        with pytest.raises(BadInput, match=rf"{name}\.mp4 {why}.*; "):
            video.probe(tmp_path / f"{name}.mp4")


SHOWN = "[Parsed_showinfo_0 @ 0x1] [info] n:{0:4d} pts: {0} pts_time:{1} pos: 1 fmt:gray s:4x4 i:P iskey:{2} type:{3}"
DECODED = [SHOWN.format(n, n / 10, int(n % 10 == 0), "I" if n % 10 == 0 else "P") for n in range(40)]


@pytest.mark.parametrize(
    ("line", "is_damage"),
    [
        ("[h264 @ 0x2] [error] co located POCs unavailable", False),
        ("[rawvideo @ 0x2] [error] Application provided invalid, non monotonically increasing dts to muxer", False),
        ("[info]     title           : [error] corrupt decoded frame", False),
        ("[h264 @ 0x2] [error] error while decoding MB 1 2, bytestream -5", True),
        ("[vist#0:0/h264 @ 0x2] [dec:h264 @ 0x3] [error] Decoding error: Invalid data found", True),
        ("[error] Error while decoding stream #0:0: Invalid data found when processing input", True),
        ("[mov,mp4,m4a,3gp,3g2,mj2 @ 0x1] [error] stream 0, offset 0x5d: partial file", True),
        ("[warning] file:x.mp4: corrupt decoded frame in stream 0", True),
    ],
)
def test_who_says_it_and_when_decides_whether_it_is_damage(line: str, is_damage: bool) -> None:
    said_at_opening = [line, "[info] Stream mapping:", *DECODED]
    assert parse_log("\n".join(said_at_opening))[2] == 0
    said_while_decoding = ["[info] Stream mapping:", *DECODED[:15], line, *DECODED[15:]]
    _, intact, n_damaged, errors = parse_log("\n".join(said_while_decoding))
    assert (n_damaged > 0, not intact.all(), len(errors) == 1) == (is_damage,) * 3


def test_streams_of_a_description_are_told_apart() -> None:
    text = """Input #0, mov,mp4,m4a,3gp,3g2,mj2, from 'file:x.mp4':
  Metadata:
    title           : Stream #0:0: Video: h264, yuv420p, 1x1
  Duration: 00:01:02.50, start: 0.000000, bitrate: 27000 kb/s
  Stream #0:0[0x1](und): Audio: aac (LC), 44100 Hz, stereo, fltp, 190 kb/s (default)
  Stream #0:1[0x2](und): Video: mjpeg (Baseline), yuvj420p(pc), 160x120, 90k tbr
  Stream #0:2[0x3](und): Video: none (mebx / 0x7862656D), 12 kb/s
  Stream #0:3[0x4](und): Video: hevc (Main), yuv420p(tv), 1920x1080, 29.98 fps, 30 tbr (default)
  Stream #0:4[0x5]: Video: png, rgb24, 600x600, 90k tbr (attached pic)
"""
    assert [(facts.stream, facts.codec) for facts in parse_description(text)] == [(3, "hevc"), (1, "mjpeg")]
