# SPDX-License-Identifier: Apache-2.0
"""Feed the readers of files with mutated files: only a result or one of our own errors may come out.

    python tests/property/fuzz_readers.py ply --inputs 100000 --seed 1

Mutations of made files, guided by coverage: what reaches a line of the reader that nothing reached before is mutated
further. Each input may take 2 s and 256 MB + 4 x its size; the address space of this process is limited to that.
"""

from __future__ import annotations

import argparse
import base64
import io
import json
import os
import resource
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import cv2
import numpy as np

from cotton3dg.choices import read_toml
from cotton3dg.core.bolls import BollSelection, LiftedMasks
from cotton3dg.core.scene import Gaussians
from cotton3dg.errors import Cotton3dgError
from cotton3dg.io import (
    annotations,
    arrays,
    cloud,
    colmap,
    images,
    mask_pngs,
    ply,
    prompt_table,
    spreadsheet,
    workbook,
    yolo_labels,
)
from cotton3dg.options import resolve
from cotton3dg.schemas import bolls
from cotton3dg.train import checkpoint
from cotton3dg.train.trainer import Training

LIMIT_S, LIMIT_BYTES = 2.0, 256 * 2**20
TRACED_SHARE = 0.1
"""Share of the inputs that are traced for coverage, which makes them some ten times slower."""
NUMBERS = [
    *(("<Q", n) for n in (0, 2**63, 2**64 - 1)), *(("<I", n) for n in (0, 2**31)), *((">I", n) for n in (0, 2**31 - 1)),
    *(("<d", x) for x in (np.nan, np.inf, 1e308)), *(("B", n) for n in (0, 255)), ("<q", -1), ("<i", -1), ("<H", 65535),
    ("<f", np.nan),
]  # fmt: skip
WORDS = [b"99999999999", b"-1", b"nan", b"1e999", b"[" * 200, b"\n", b"{}", b"'", b"\xff\xfe", b"null", b"\0" * 64]
MAGIC = [struct.pack(layout, value) for layout, value in NUMBERS] + WORDS
"""What tends to break readers."""

Read = Callable[[Path], object]


def some_gaussians(n: int, k: int) -> Gaussians:
    rng = np.random.default_rng(n)
    shapes = ((n, 3), (n, 4), (n, 3), (n,), (n, k, 3))
    return Gaussians(*(rng.normal(size=shape).astype(np.float32) for shape in shapes))


def written(write: Callable[[Path], object]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder) / "file")
        return (Path(folder) / "file").read_bytes()


def png(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def lifted() -> LiftedMasks:
    chosen = BollSelection("a.jpg", 3, np.arange(4), np.ones(4, np.float32))
    return LiftedMasks("ab", ("a.jpg",), np.arange(5), np.ones(5, np.float32), np.ones((1, 5), np.float32), (chosen,))


def npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def colmap_files() -> dict[str, bytes]:
    cameras = struct.pack("<QiiQQ4d", 1, 1, 1, 640, 480, 500.0, 500.0, 320.0, 240.0)
    image = struct.pack("<I7dI", 1, 1.0, 0, 0, 0, 0.1, 0.2, 3.0, 1)
    shown = [image + b"%06d.jpg\0" % i + struct.pack("<Q2dq", 1, 1.5, 2.5, 7) for i in range(3)]
    points = [struct.pack("<Q3d3BdQ2I", i, 0.1 * i, 0.2, 3.0, 9, 8, 7, 0.5, 1, 1, 0) for i in range(4)]
    return {
        "cameras.bin": cameras,
        "images.bin": struct.pack("<Q", 3) + b"".join(shown),
        "points3D.bin": struct.pack("<Q", 4) + b"".join(points),
    }


def model_with(name: str, read: Callable[[Path], object]) -> Read:
    """A reader of a folder in which `name` is the mutated file and the others are sound."""

    def read_model(path: Path) -> object:
        for other, content in colmap_files().items():
            if not (path.parent / other).exists():
                (path.parent / other).write_bytes(content)
        path.replace(path.parent / name)
        return read(path.parent)

    return read_model


def renamed(name: str, read: Callable[[Path], object]) -> Read:
    """A reader of a folder with the file under a name."""

    def read_folder(path: Path) -> object:
        path.replace(path.with_name(name))
        return read(path.parent)

    return read_folder


def all_numbers(path: Path) -> object:
    table = spreadsheet.read_table(path)
    return [table.numbers(column) for column in table.columns]


def toml_options(path: Path) -> object:
    return [resolve(stage, table) for stage, table in read_toml(path).items() if stage != "preset"]


def coco() -> bytes:
    shape = {"id": 1, "image_id": 1, "category_id": 1, "segmentation": [[1, 1, 8, 1, 8, 8]], "score": 0.5}
    lengths = {"id": 2, "image_id": 1, "segmentation": {"size": [12, 10], "counts": [30, 20, 70]}}
    packed = {"id": 3, "image_id": 1, "segmentation": {"size": [12, 10], "counts": "n0d0V2"}}
    picture = {"id": 1, "file_name": "a.jpg", "width": 10, "height": 12}
    return json.dumps({"images": [picture], "annotations": [shape, lengths, packed]}).encode()


def labelme() -> bytes:
    drawn = {"label": "boll", "points": [[1, 1], [8, 1], [8, 8]], "shape_type": "polygon", "group_id": 1}
    pasted = base64.b64encode(png(np.full((3, 4), 255, np.uint8))).decode()
    mask = {"label": "boll", "points": [[2, 3], [5, 5]], "shape_type": "mask", "mask": pasted}
    return json.dumps({"imagePath": "a.jpg", "imageHeight": 12, "imageWidth": 10, "shapes": [drawn, mask]}).encode()


def targets() -> dict[str, tuple[Read, list[bytes]]]:
    """Readers by name, each with sound files to start from."""
    rng = np.random.default_rng(0)
    ids = rng.integers(0, 4, (12, 10)).astype(np.uint16)
    photo = cv2.resize(rng.integers(0, 255, (4, 5, 3), np.uint8), (40, 32))
    blocks = np.kron(rng.integers(0, 255, (3, 4, 2), np.uint8), np.ones((8, 8, 1), np.uint8))
    jpeg = cv2.imencode(".jpg", photo)[1].tobytes()
    training = Training.of(some_gaussians(3, 4))
    model = colmap_files()
    return {
        "ply": (
            ply.read_gaussians,
            [written(lambda path, k=k: ply.write_gaussians(path, some_gaussians(3, k))) for k in (1, 4, 16)],
        ),
        "npz": (bolls.read_lifted, [written(lambda path: bolls.write_lifted(path, lifted()))]),
        "checkpoint": (
            lambda path: checkpoint.read_training(path, "key"),
            [written(lambda path: checkpoint.write_training(path, training, "key"))],
        ),
        "npy": (arrays.read_array, [npy(np.arange(5, dtype=np.int32)), npy(np.zeros((2, 3), order="F"))]),
        "cameras": (model_with("cameras.bin", colmap.read_cameras), [model["cameras.bin"]]),
        "images": (model_with("images.bin", colmap.read_cameras), [model["images.bin"]]),
        "points": (model_with("points3D.bin", colmap.read_points), [model["points3D.bin"]]),
        "mask": (images.read_ids, [png(ids), png(ids.astype(np.uint8))]),
        "photo": (images.read_image, [jpeg, png(photo)]),
        "coco": (annotations.read_masks, [coco()]),
        "labelme": (annotations.read_masks, [labelme()]),
        "yolo_labels": (
            lambda path: yolo_labels.read_yolo_labels(path, 12, 10, {0: "boll"}),
            [b"0 0.1 0.1 0.8 0.1 0.8 0.7\n1 0.2 0.2 0.9 0.2 0.9 0.9 0.5\n"],
        ),
        "class_names": (
            renamed("data.yaml", yolo_labels.read_class_names),
            [
                b"nc: 2\nnames:\n- 'a ''b'\n- \"\\u68c9\" # c\nval: x\n",
                b"names: {0: a, 1: 'b'}\n",
                b"names: ['a', b]\n",
            ],
        ),
        "drawn": (
            lambda path: mask_pngs.read_mask_pngs([path]),
            [png(ids), png((255 * (ids > 1)).astype(np.uint8)), png(np.dstack([blocks, blocks]))],
        ),
        "table": (
            all_numbers,
            [
                b"a,b\n1,2.5\n2,\n",
                "sep=;\na;b\n1.234,5;NA\n2;1 234,5\n".encode("utf-16"),
                written(lambda path: workbook.write_workbook(path, {"s": (["a", "b"], [[1.0, "NA"], [2.5, "0,5"]])})),
            ],
        ),
        "cloud": (
            renamed("a.xyz", lambda folder: cloud.read_cloud(folder / "a.xyz", 1.0)),
            [b"//X Y Z I\n1 2 3 4\n5 6 7 8\n2 2 2 2\n3 3 3 3\n", b"1,5;2;3\n2;3,5;4\n3;4;5\n0;0;1\n"],
        ),
        "prompts": (prompt_table.read_prompts, [b"image,x,y\na,1,2\n", b"image,x1,y1,x2,y2\na.jpg,1,2,3,4.5\n"]),
        "toml": (toml_options, [b"[train]\nsteps = 3000\ndssim = 0.2\n[masks]\nbackend = \"bolls\"\n# a\n"]),
    }  # fmt: skip


def mutated(content: bytes, other: bytes, rng: np.random.Generator) -> bytes:
    """A few random changes: bytes, bits, magic values, blocks cut, doubled, moved or taken from another file."""
    work = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        n = len(work)
        at, length = (int(rng.integers(0, n + 1)), int(rng.integers(1, 40))) if n else (0, 1)
        kind = int(rng.integers(0, 8))
        if kind == 0 and at < n:
            work[at] = int(rng.integers(0, 256))
        elif kind == 1 and at < n:
            work[at] ^= 1 << int(rng.integers(0, 8))
        elif kind == 2:
            value = MAGIC[int(rng.integers(0, len(MAGIC)))]
            work[at : at + len(value)] = value
        elif kind == 3:
            work[at:at] = MAGIC[int(rng.integers(0, len(MAGIC)))]
        elif kind == 4:
            del work[at : at + length]
        elif kind == 5:
            work[at:at] = work[at : at + length]
        elif kind == 6 and other:
            start = int(rng.integers(0, len(other)))
            work[at : at + length] = other[start : start + length]
        elif kind == 7 and rng.random() < 0.2:
            del work[at:]
    return bytes(work)


class Reached:
    """Lines of the package that a call reaches; only traced calls add to it."""

    def __init__(self) -> None:
        self.lines: set[tuple[str, int]] = set()

    def grows(self, call: Callable[[], object]) -> bool:
        before = len(self.lines)

        def trace(frame: FrameType, event: str, _: Any) -> Any:
            if "cotton3dg" not in frame.f_code.co_filename:
                return None
            self.lines.add((frame.f_code.co_filename, frame.f_lineno))
            return trace

        sys.settrace(trace)
        try:
            call()
        finally:
            sys.settrace(None)
        return len(self.lines) > before


class Checked:
    """Calls a reader with the bytes of a file and checks what comes out and how long it takes."""

    def __init__(self, name: str, folder: Path) -> None:
        self.read, self.seeds = targets()[name]
        self.path = folder / ("file.json" if name in ("coco", "labelme") else "file")
        self.n = self.refused = 0
        self.slowest_s = 0.0

    def __call__(self, content: bytes) -> None:
        self.path.write_bytes(content)
        began = time.process_time()
        try:
            self.read(self.path)
        except Cotton3dgError as error:
            self.refused += 1
            assert ";" in str(error), f"no remedy in {str(error)!r}"
        except BaseException:
            Path(f"crash-{os.getpid()}").write_bytes(content)
            raise
        seconds = time.process_time() - began
        self.n, self.slowest_s = self.n + 1, max(self.slowest_s, seconds)
        assert seconds <= LIMIT_S, f"{seconds:.1f} s for {len(content)} bytes"


def limit_memory(largest: int) -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + LIMIT_BYTES + 4 * largest,) * 2)


def fuzz(check: Checked, n_inputs: int, seed: int) -> None:
    rng, corpus, reached = np.random.default_rng(seed), list(check.seeds), Reached()
    for content in corpus:
        reached.grows(lambda content=content: check(content))  # type: ignore[misc]
        assert check.refused == 0, "a sound file is refused"
    limit_memory(max(map(len, corpus)) + 1000)
    while check.n < n_inputs:
        first, second = (corpus[int(rng.integers(0, len(corpus)))] for _ in range(2))
        content = mutated(first, second, rng)
        if rng.random() >= TRACED_SHARE:
            check(content)
        elif reached.grows(lambda content=content: check(content)):  # type: ignore[misc]
            corpus.append(content)
    print(
        f"{check.n} inputs, {check.refused} refused, {len(corpus) - len(check.seeds)} reached new lines, "
        f"slowest {check.slowest_s:.3f} s"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", choices=list(targets()))
    parser.add_argument("--inputs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        fuzz(Checked(wanted.target, Path(scratch)), wanted.inputs, wanted.seed)
