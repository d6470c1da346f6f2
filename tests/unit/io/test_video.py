# SPDX-License-Identifier: Apache-2.0
"""Videos read through ffmpeg. Every frame of the made clips carries its number, so that none passes for another."""

import subprocess

import cv2
import numpy as np
import pytest

from cotton3dg.errors import BadInput, EnvironmentUnusable, MissingInput
from cotton3dg.io import ffmpeg_text, video

WIDTH, HEIGHT, BITS = 160, 90, 8


def numbered(number, width=WIDTH, height=HEIGHT):
    """A grey frame with its number as a row of black and white squares on top and a light bottom-right quarter."""
    frame = np.full((height, width, 3), 60, np.uint8)
    frame[height // 2 :, width // 2 :] = 180
    side = width // BITS
    for bit in range(BITS):
        frame[:side, bit * side : (bit + 1) * side] = 235 if number >> bit & 1 else 16
    return frame


def number_of(frame):
    """The number that `numbered` drew, in a frame of any size."""
    grey = frame if frame.ndim == 2 else frame.mean(axis=2)
    side = grey.shape[1] // BITS
    return sum(int(grey[side // 2, bit * side + side // 2] > 128) << bit for bit in range(BITS))


def encode(path, n_frames, *arguments, rate=25, width=WIDTH, height=HEIGHT):
    """A clip of numbered frames, encoded with extra ffmpeg output arguments."""
    frames = b"".join(numbered(n, width, height).tobytes() for n in range(n_frames))
    command = [video.ffmpeg_binary(), "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{width}x{height}", "-r", str(rate), "-i", "pipe:0"]
    subprocess.run([*command, *arguments, f"file:{path}"], input=frames, check=True)
    return path


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """50 frames at 25 frames a second, a key frame every 10."""
    return encode(tmp_path_factory.mktemp("clip") / "clip.mp4", 50, "-pix_fmt", "yuv420p", "-g", "10")


def scanned(path, max_side=WIDTH):
    return video.scan(path, video.probe(path), max_side, lambda frame: number_of(frame.grey(max_side)))


def test_header(clip):
    facts = video.probe(clip)
    assert (facts.codec, facts.width, facts.height, facts.rotation_deg) == ("h264", WIDTH, HEIGHT, 0)
    assert (facts.fps, facts.duration_s, facts.is_hdr) == (25.0, 2.0, False)


def test_every_frame_is_seen_once_with_its_time(clip):
    scan = scanned(clip)
    assert scan.measures == list(range(50))
    np.testing.assert_allclose(scan.timestamps_s, np.arange(50) / 25, atol=1e-4)
    assert scan.intact.all() and not scan.errors


def test_wanted_frames_come_out_upright_and_scaled(clip):
    frames = list(video.read_frames(clip, video.probe(clip), [0, 7, 31, 49], 80))
    assert [number_of(frame) for frame in frames] == [0, 7, 31, 49]
    assert frames[0].shape == (45, 80, 3) and frames[0].dtype == np.uint8
    assert frames[0][40, 70].mean() == pytest.approx(180, abs=6)


def test_a_thousand_wanted_frames_fit_into_one_filter(clip):
    with pytest.raises(BadInput, match="50 of 2000 frames"):
        list(video.read_frames(clip, video.probe(clip), list(range(2000)), 80))


def test_variable_frame_rate_keeps_true_times(tmp_path):
    # Frame n is shown at n + (n/10)^3 hundredths of a second.
    path = encode(
        tmp_path / "vfr.mkv", 40, "-vf", "settb=1/1000,setpts=10*(N+pow(N/10\\,3))", "-enc_time_base", "1/1000"
    )
    scan = scanned(path)
    n = np.arange(40)
    assert scan.measures == list(range(40))
    np.testing.assert_allclose(scan.timestamps_s, 0.01 * (n + (n / 10) ** 3), atol=2e-3)
    assert [number_of(f) for f in video.read_frames(path, video.probe(path), [3, 38], 160)] == [3, 38]


@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
def test_rotation_tag_is_applied(clip, tmp_path, degrees):
    path = tmp_path / "turned.mp4"
    described = subprocess.run([video.ffmpeg_binary(), "-h", "full"], capture_output=True, check=True).stdout
    if b"-display_rotation" in described:
        arguments = ["-display_rotation:v:0", str(-degrees), "-i", str(clip), "-c", "copy"]
    else:
        arguments = ["-i", str(clip), "-c", "copy", "-metadata:s:v:0", f"rotate={-degrees % 360}"]
    subprocess.run([video.ffmpeg_binary(), "-v", "error", *arguments, str(path)], check=True)
    facts = video.probe(path)
    assert facts.rotation_deg == degrees
    assert (facts.width, facts.height) == ((WIDTH, HEIGHT) if degrees % 180 == 0 else (HEIGHT, WIDTH))
    (frame,) = video.read_frames(path, facts, [5], 160)
    upright = np.rot90(frame, degrees // 90)  # counter-clockwise, taking the tag's clockwise turn back
    assert number_of(upright) == 5


@pytest.mark.parametrize(("width", "height"), [(161, 91), (97, 33)])
def test_odd_sizes(tmp_path, width, height):
    path = encode(tmp_path / "odd.mkv", 5, "-pix_fmt", "yuv444p", width=width, height=height)
    frames = list(video.read_frames(path, video.probe(path), [2], 1000))
    assert frames[0].shape == (height, width, 3) and number_of(frames[0]) == 2


def test_pixel_aspect_is_applied(tmp_path):
    path = encode(tmp_path / "wide.mp4", 5, "-vf", "setsar=2/1", "-pix_fmt", "yuv420p")
    facts = video.probe(path)
    assert (facts.width, facts.height) == (2 * WIDTH, HEIGHT)


@pytest.mark.parametrize("transfer", ["smpte2084", "arib-std-b67"])
def test_hdr_is_tone_mapped(tmp_path, transfer):
    tags = f"setparams=color_primaries=bt2020:color_trc={transfer}:colorspace=bt2020nc"
    path = encode(
        tmp_path / "hdr.mp4",
        4,
        *("-vf", f"scale=out_color_matrix=bt2020,format=yuv420p10le,{tags}"),
        *("-c:v", "libx265", "-x265-params", "log-level=none"),
    )
    facts = video.probe(path)
    assert (facts.transfer, facts.pixel_format, facts.is_hdr) == (transfer, "yuv420p10le", True)
    frames = list(video.read_frames(path, facts, [1, 3], 160))
    assert frames[0].dtype == np.uint8 and frames[0][80, 10].mean() < frames[0][80, 150].mean()
    # A signal of 180/255 is a little below diffuse white in HLG (75 %) and well above it in PQ (58 %).
    assert (frames[0][80, 150] > (200 if transfer == "arib-std-b67" else 235)).all()


HOSTILE_NAMES = (
    "a:b.mp4",
    "%d.mp4",
    "%03d.mp4",
    "-i.mp4",
    "--help.mp4",
    "two words.mp4",
    "it's.mp4",
    'double"quote.mp4',
    "new\nline.mp4",
    "semi;colon.mp4",
    "$(touch x).mp4",
    "`touch x`.mp4",
    "pipe|.mp4",
    "a&b.mp4",
    "http:x.mp4",
    "concat:a|b.mp4",
    "ünïcödé.mp4",
    "back\\slash.mp4",
    "[0:v].mp4",
    "a,b=c.mp4",
    "*.mp4",
    "#hash?.mp4",
)


@pytest.mark.parametrize("name", HOSTILE_NAMES)
def test_hostile_names_are_only_names(clip, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name
    path.write_bytes(clip.read_bytes())
    assert [number_of(f) for f in video.read_frames(path, video.probe(path), [9], 160)] == [9]
    assert [found.name for found in tmp_path.iterdir()] == [name]


def test_truncated_clip_shows_what_is_left(clip, tmp_path):
    path = encode(tmp_path / "front.mp4", 50, "-pix_fmt", "yuv420p", "-g", "10", "-movflags", "+faststart")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 6 // 10])
    facts, scan = video.probe(path), scanned(path)
    assert facts.duration_s == 2.0  # what the header still claims
    assert 5 < len(scan.measures) < 45
    assert scan.errors


def test_bit_rot_is_noticed_and_ends_at_a_key_frame(tmp_path):
    path = encode(tmp_path / "rot.mp4", 120, "-pix_fmt", "yuv420p", "-g", "10", "-bf", "0")
    content = bytearray(path.read_bytes())
    start = content.index(b"mdat") + 1200
    content[start : start + 60] = bytes(60)
    path.write_bytes(content)
    scan = scanned(path)
    assert scan.errors and not scan.intact.all()
    assert scan.intact[-20:].all()


def test_log_without_key_frame_after_damage_trusts_nothing_after_it():
    shown = "[Parsed_showinfo_2 @ 0x1] [info] n:{0:4d} pts: {0} pts_time:{1} pos: 1 fmt:gray iskey:{2} type:{3}"
    lines = [shown.format(n, n / 10, int(n == 0), "I" if n == 0 else "P") for n in range(20)]
    lines.insert(12, "[h264 @ 0x2] [error] error while decoding MB 1 2, bytestream -5")
    timestamps_s, intact, n_damaged, errors = ffmpeg_text.parse_log("\n".join(lines))
    assert n_damaged == 9
    assert intact.tolist() == [True] * 11 + [False] * 9
    assert len(errors) == 1 and timestamps_s[19] == 1.9


@pytest.mark.parametrize(
    "content",
    [b"no video", b"#EXTM3U\n#EXTINF:1,\n/etc/passwd\n", b"ffconcat version 1.0\nfile '/etc/passwd'\n"],
)
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "x.mp4").write_bytes(content)
    with pytest.raises(BadInput, match=r"x\.mp4 is not a video"):
        video.probe(tmp_path / "x.mp4")


def test_missing_file(tmp_path):
    with pytest.raises(MissingInput):
        video.probe(tmp_path / "x.mp4")


def test_without_any_ffmpeg_the_remedy_is_named(monkeypatch):
    import imageio_ffmpeg

    def missing():
        raise RuntimeError("No ffmpeg exe could be found")

    monkeypatch.setattr(video.shutil, "which", lambda _: None)
    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", missing)
    with pytest.raises(EnvironmentUnusable, match="install ffmpeg"):
        video.ffmpeg_binary()


def test_descriptions_of_phones():
    iphone = """Input #0, mov,mp4,m4a,3gp,3g2,mj2, from 'file:x.MOV':
  Duration: 00:01:02.50, start: 0.000000, bitrate: 27000 kb/s
  Stream #0:0[0x1](und): Video: hevc (Main 10) (hvc1 / 0x31637668), yuv420p10le(tv, bt2020nc/bt2020/arib-std-b67), \
1920x1080, 26800 kb/s, 29.98 fps, 30 tbr, 600 tbn (default)
    Side data:
      DOVI configuration record: version: 1.0, profile: 8
      displaymatrix: rotation of -90.00 degrees
  Stream #0:1[0x2](und): Audio: aac (LC) (mp4a / 0x6134706D), 44100 Hz, stereo, fltp, 190 kb/s (default)
"""
    (facts,) = ffmpeg_text.parse_description(iphone)
    assert facts == ffmpeg_text.VideoFacts(
        "hevc", 1080, 1920, 90, "yuv420p10le", "arib-std-b67", "bt2020nc", False, 29.98, 62.5
    )
    cover = "  Stream #0:0: Video: mjpeg (Baseline), yuvj420p(pc), 600x600, 90k tbr (attached pic)\n"
    assert ffmpeg_text.parse_description(cover) == []
    assert ffmpeg_text.parse_description("") == []


def test_ten_bit_standard_range_is_left_as_filmed(tmp_path):
    path = encode(tmp_path / "ten.mkv", 3, "-vf", "format=yuv420p10le", "-c:v", "ffv1")
    facts = video.probe(path)
    assert facts.pixel_format == "yuv420p10le" and not facts.is_hdr
    (frame,) = video.read_frames(path, facts, [1], 160)
    assert frame[80, 150].mean() == pytest.approx(180, abs=3)


def test_frames_measured_are_the_frames_written(clip):
    """Sharpness is judged in one pass and the frame taken in another: their numbers must mean the same."""
    scan = scanned(clip)
    taken = [cv2.cvtColor(f, cv2.COLOR_RGB2GRAY) for f in video.read_frames(clip, video.probe(clip), [4, 44], 160)]
    assert [scan.measures[4], scan.measures[44]] == [number_of(frame) for frame in taken]


@pytest.mark.parametrize(
    ("pixel_format", "tags"),
    [("yuv420p", ""), ("yuv420p", "bt709"), ("yuvj420p", "bt709"), ("yuv444p", "smpte170m"), ("yuv420p10le", "")],
)
def test_colours_are_those_of_the_film(tmp_path, pixel_format: str, tags: str) -> None:
    path = tmp_path / "film.mkv"
    rng = np.random.default_rng(3)
    picture = cv2.resize(rng.integers(0, 256, (6, 10, 3), np.uint8), (160, 90), interpolation=cv2.INTER_CUBIC)
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "160x90", "-r", "5"]
    matrix = {"bt709": ":out_color_matrix=bt709"}.get(tags, "")
    command += ["-i", "pipe:0", "-vf", f"scale=iw:ih{matrix}", "-pix_fmt", pixel_format, "-c:v", "ffv1"]
    command += ["-colorspace", tags, "-color_primaries", tags, "-color_trc", tags] if tags else []
    subprocess.run([*command, str(path)], input=picture.tobytes() * 3, check=True)
    facts = video.probe(path)
    scan = video.scan(path, facts, 1000, lambda frame: frame.rgb())
    (by_ffmpeg,) = video.read_frames(path, facts, [1], 1000)
    error, of_ffmpeg = (np.abs(rgb.astype(int) - picture).mean() for rgb in (scan.measures[1], by_ffmpeg))
    assert error < max(1.0, of_ffmpeg)
    assert np.abs(scan.measures[1].mean(axis=(0, 1)) - by_ffmpeg.mean(axis=(0, 1))).max() < 1.0


def test_every_second_frame_of_a_fast_film_is_looked_at(tmp_path) -> None:
    path = tmp_path / "fast.mkv"
    frames = b"".join(np.full((36, 64, 3), 4 * k, np.uint8).tobytes() for k in range(41))
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "64x36", "-r", "60"]
    subprocess.run([*command, "-i", "pipe:0", "-c:v", "ffv1", str(path)], input=frames, check=True)
    scan = video.scan(path, video.probe(path), 64, lambda frame: round(float(frame.grey(64).mean())), every=2)
    np.testing.assert_allclose(scan.measures, np.arange(0, 164, 8), atol=2)
    assert len(scan.timestamps_s) == 41 == scan.intact.sum()


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuvj420p"])
def test_a_grey_picture_outlives_its_frame(tmp_path, pixel_format: str) -> None:
    """Of full-range film it once was the buffer that the next frame is read into, so that nothing seemed to move."""
    path = tmp_path / "film.mkv"
    frames = b"".join(np.full((36, 64, 3), 40 * k, np.uint8).tobytes() for k in range(6))
    command = [video.ffmpeg_binary(), "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "64x36", "-r", "25"]
    command += ["-i", "pipe:0", "-vf", "scale=iw:ih", "-pix_fmt", pixel_format, "-c:v", "ffv1", str(path)]
    subprocess.run(command, input=frames, check=True)
    scan = video.scan(path, video.probe(path), 64, lambda frame: frame.grey(64))
    np.testing.assert_allclose([grey.mean() for grey in scan.measures], np.arange(0, 240, 40), atol=2)
