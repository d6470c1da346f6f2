# SPDX-License-Identifier: Apache-2.0
"""mBIoU of single bolls, each the only target: the layout of Table II of the seed paper "binary segmentation".

    python tests/accuracy/single_targets.py PLANT [--targets 1 5 9] [--masks found] [--steps 7000]

PLANT and --masks as in segmentation_sweep.py; the ids of masks of `bolls` are the same in all images. A row a boll, on
the views that trained and on those held out.
"""

from __future__ import annotations

import argparse
import tempfile

import numpy as np
import pandas as pd
from segmentation_sweep import MASKS, masks_of, spread, with_masks
from true_scene import true_plant

from cotton3dg.options import ProbabilityOptions, resolve
from cotton3dg.schemas.segment import SegmentInfo
from cotton3dg.segment import stage as segment


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plant", type=true_plant, metavar="PLANT")
    parser.add_argument("--targets", nargs="+", type=int, help="mask ids; default: all")
    parser.add_argument("--masks", choices=MASKS, default="found")
    parser.add_argument("--views", type=int, default=36)
    parser.add_argument("--steps", type=int, default=ProbabilityOptions.steps)
    wanted = parser.parse_args()
    masks = spread(wanted.plant.run, masks_of(wanted.plant, wanted.masks), wanted.views)
    targets = wanted.targets or np.unique(np.concatenate([np.unique(ids[ids > 0]) for ids in masks.values()])).tolist()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        scratch = with_masks(wanted.plant.run, masks, folder)
        for target in targets:
            segment.run(scratch, resolve("segment", {"method": "probability", "target": target, "steps": wanted.steps}))
            last = (SegmentInfo.load(scratch.segment_json).by_steps or ())[-1]
            held_out = {f"held_out_{name}": iou for name, iou in (last.mbiou_held_out or {}).items()}
            rows.append({"target": target, "seconds": last.seconds, **(last.mbiou or {}), **held_out})
    table = pd.DataFrame(rows)
    print(table.to_string(index=False, float_format="{:.3f}".format))
    print("\nMeans:\n")
    print(table.drop(columns="target").astype(float).mean().to_string(float_format="{:.3f}".format))


if __name__ == "__main__":
    main()
