#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Every plant below a folder, and how far their traits are from a table of the truth: RMSE, MAPE, bias and R2 of each
# trait that both tables have, plants matched by plant_id, and a scatter plot each (examples/truth.csv shows the columns).
#
#   examples/against_truth.sh field_2026/ lidar.csv scores/
set -euo pipefail
plants=${1:?folder with one folder a plant} truth=${2:?CSV of the truth} scores=${3:?folder for the scores}
cotton3dg batch "$plants" || [ $? = 8 ] # some plants failed: batch.csv says which, the others are compared
cotton3dg evaluate "$plants/batch.csv" --truth "$truth" --out "$scores"
