#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A finished plant, measured again with your own boll masks: a COCO file (polygons or RLE) of some or all of its images.
#
#   cotton3dg masks-export plant_017                     # plant_017/annotations: images and masks, to be corrected
#   examples/own_coco_masks.sh plant_017 corrected.json
#
# Both rows are kept: traits.csv of the masks that were found, and that of your own in the plant's folder.
set -euo pipefail
plant=${1:?folder of a finished plant} masks=${2:?COCO file}
cp "$plant/traits/traits.csv" "$plant/traits_of_found_masks.csv"
cotton3dg run "$plant" --set masks.backend=import --set masks.source="$(realpath "$masks")"
cut -d , -f 1-5 "$plant/traits_of_found_masks.csv" "$plant/traits/traits.csv"
