#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# One plant, from its video to its row.
#
#   examples/one_plant.sh walk.mp4 plant_017
set -euo pipefail
video=${1:?video of one walk around the plant} plant=${2:?folder for the plant; made if needed}
mkdir -p "$plant"
cp "$video" "$plant"/
cotton3dg run "$plant"
cotton3dg status "$plant"
echo "look at $plant/report.html, compute with $plant/traits/traits.csv and $plant/traits/bolls.csv"
