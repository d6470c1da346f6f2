#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Every plant below a folder, one after the other, and one table of all of them.
#
#   examples/many_plants.sh field_2026/ all_plants.csv
#
# Start it again at any time: finished plants are skipped in seconds, failed ones are tried again.
set -u
plants=${1:?folder with one folder a plant} table=${2:?CSV to write}
failed=0
for plant in "$plants"/*/; do
  cotton3dg run "$plant" || failed=$((failed + 1))
done
awk 'FNR > 1 || !header++' "$plants"/*/traits/traits.csv >"$table"
echo "saved $table; $failed plants failed, their reasons stand above and in each plant's run.log"
[ "$failed" = 0 ]
