# SPDX-License-Identifier: Apache-2.0
"""What users do by mistake, and what happens to them, on finished plants and fields: the rows of `make mistakes`.

`plant_1` is finished, by its own cotton3dg.toml; `field` has two finished plants, plant_1 and plant_2, by the field's
cotton3dg.toml, and their tables; `fresh` holds only film.mp4, as does the folder that all are in.
"""

from __future__ import annotations

from typing import Final

from scenes.mistakes import Mistake

NOT_THERE: Final = r"(not there|not exist|is missing|not a folder|no such).*; \w"
"""The words for what is named and is not there, and a remedy."""
SILENT: Final = ""
"""Of what has no mistake to name: it works, or was ended by the system."""
BATCH: Final = ("field/batch.csv", "field/batch_bolls.csv", "field/index.html")
CHECKED: Final = ("plant_1/check", "plant_1/check/*")
TIMED: Final = (
    "plant_1/records/*", "plant_1/run.log", "plant_1/report.html", "plant_1/traits/traits.csv", "plant_1/train/*.json",
    "plant_1/masks/masks.json", "plant_1/segment/segment.json",
)  # fmt: skip
"""What has the seconds of a run in it, or other last digits of the evidence for a rolling shutter."""
READ_ONLY: Final = "mkdir probe; chmod a-w probe; ! touch probe/x"
TRAINS: Final = "until tail -n 1 plant_1/run.log | grep -q 'train starts: forced'; do sleep 0.1; done; sleep 1; "
CONTINUE: Final = "cotton3dg run plant_1"
TRAIN: Final = f"{CONTINUE} --from train --force & "

TYPED: Final = (
    Mistake("a stage misspelt in an option", "cotton3dg run plant_1 --set tran.steps=100", "did you mean.*train"),
    Mistake("an option misspelt", "cotton3dg run plant_1 --set train.stepps=100", "did you mean.*steps"),
    Mistake("an option without its value", "cotton3dg run plant_1 --set train.steps=", "steps.*number"),
    Mistake("a decimal comma", "cotton3dg run plant_1 --set train.steps=1,5", "steps.*number"),
    Mistake("a negative count", "cotton3dg run plant_1 --set frames.count=-5", "count.*at least 8"),
    Mistake("a preset misspelt", "cotton3dg run plant_1 --preset drft", "draft"),
    Mistake("a flag misspelt", "cotton3dg run plant_1 --presett draft", r"no such option.*--preset\b"),
    Mistake("a command misspelt", "cotton3dg rnu plant_1", "no such command.*run"),
    Mistake("a command without its folder", "cotton3dg run", "missing argument.*plant_dir"),
    Mistake("a last stage that does not exist", "cotton3dg run plant_1 --until harvest", "use .*traits"),
    Mistake("stages in the wrong order", "cotton3dg run plant_1 --from traits --until frames", "order is .*traits"),
    Mistake("a time without its unit", "cotton3dg run plant_1 --time-budget 10", "10m|minutes"),
    Mistake("repeats of a part", "cotton3dg run plant_1 --repeat 2 --until sfm", "leave out"),
    Mistake("fewer jobs than none", "cotton3dg batch field --jobs -1", "jobs.*(at least|range)"),
    Mistake("missing weights", "cotton3dg masks plant_1 --weights /no/such.onnx", rf"such\.onnx.*{NOT_THERE}"),
    Mistake("a film for weights", "cotton3dg masks plant_1 --weights film.mp4", r"film\.mp4.*; \w"),
    Mistake("a back end without weights", "cotton3dg masks plant_1 --backend sam", "--weights", (2, 3)),
    Mistake("a film for a model", "cotton3dg train plant_1 --model film.mp4", r"film\.mp4.*; \w"),
    Mistake("a film of no images", "cotton3dg render plant_1 --frames 0", "frames.*at least 1"),
    Mistake("a sweep that does not exist", "cotton3dg study plant_1 --sweep nosuch", "use .*resolution"),
    Mistake("an export format misspelt", "cotton3dg export field --format xslx", "(use|mean).*xlsx"),
    Mistake("Slurm on a laptop", "cotton3dg batch field --engine slurm", r"(slurm|sbatch).*; \w", (3,)),
    Mistake("a thousand jobs", "cotton3dg batch field --jobs 1000", "2 of 2 plants done", (0,), may_change=BATCH),
    Mistake("a folder that does not exist", "cotton3dg run nosuch", NOT_THERE),
    Mistake("the same for doctor", "cotton3dg doctor nosuch", NOT_THERE),
    Mistake("a field that does not exist", "cotton3dg batch nosuch", NOT_THERE),
    Mistake("a missing field book", "cotton3dg cards nosuch.csv cards.pdf", rf"nosuch\.csv.*{NOT_THERE}"),
    Mistake("missing corrections", "cotton3dg correct plant_1 nosuch.json", rf"nosuch\.json.*{NOT_THERE}"),
    Mistake("missing annotations", "cotton3dg masks-train model --annotations nosuch", NOT_THERE),
    Mistake("a missing truth", "cotton3dg evaluate plant_1 --truth nosuch.json", rf"nosuch\.json.*{NOT_THERE}"),
    Mistake("missing weights of plants", "cotton3dg evaluate-weights nosuch.csv", rf"nosuch\.csv.*{NOT_THERE}"),
    Mistake("a truth that is not named", "cotton3dg evaluate field/batch.csv", "--truth"),
    Mistake("a comparison in /proc", "cotton3dg compare plant_1 field/plant_1 --out /proc/q", r"; \w", (2, 3)),
    Mistake("a demonstration in /proc", "cotton3dg demo /proc/x", r"; \w", (2, 3)),
)  # fmt: skip
"""Options and names that are wrong."""

PLACES: Final = (
    Mistake("the folder above the plants", "cotton3dg run field", "cotton3dg batch"),
    Mistake("the same, to check", "cotton3dg check field", "plant_1|cotton3dg batch"),
    Mistake("a plant for a field", "cotton3dg batch plant_1", "cotton3dg run"),
    Mistake("every plant of a field at once", "cotton3dg batch field/*", "unexpected extra argument"),
    Mistake(
        "a batch after that", "cotton3dg batch field --status", "2 of 2 plants done", (0,),
        before="cotton3dg run field; cotton3dg check field; cotton3dg batch field/plant_1; true", may_change=BATCH,
    ),
    Mistake("an export of a plant", "cotton3dg export plant_1", r"; \w"),
    Mistake("one film to compare", "cotton3dg compare plant_1", "two folders or more"),
    Mistake("the status of a film", "cotton3dg status film.mp4", "cotton3dg run film.mp4"),
    Mistake(
        "a letter for a film", "cotton3dg run letter.mp4", r"; \w", (2, 4), "echo 'Dear breeder' > letter.mp4",
        may_change=("letter", "letter/*"),
    ),
    Mistake("a field without plants", "cotton3dg batch empty", "put each plant's video", (2,), "mkdir empty"),
    Mistake(
        "an import without films", "cotton3dg import notes --into field_2", "no video", (2,),
        "mkdir notes; echo rain > notes/monday.txt",
    ),
    Mistake("an import into a plant", "cotton3dg import film.mp4 --into plant_1", "plant"),
    Mistake("a demonstration beside one's film", "cotton3dg demo fresh", "give a new folder"),
    Mistake("a simulation beside one's film", "cotton3dg simulate fresh", "give a new folder"),
    Mistake("cards over the field book", "cotton3dg cards book.csv", r"\.pdf", (2,), "echo plant_id > book.csv"),
    Mistake("a bug report over a table", "cotton3dg bug-report plant_1 --out plant_1/traits/traits.csv", r"\.zip"),
    Mistake("traits before all else", "cotton3dg traits fresh", r"run `cotton3dg \w+"),
    Mistake(
        "a render before the training", "cotton3dg render fresh", "run `cotton3dg (train|run)",
        may_change=("fresh/.lock",),
    ),
    Mistake("a comparison with no result", "cotton3dg compare plant_1 fresh", r"fresh.*run `cotton3dg \w+"),
    Mistake(
        "a report of nothing", "cotton3dg report fresh", "cotton3dg run|saved as", (0, 2),
        may_change=("fresh/report.html", "fresh/records*", "fresh/.lock"),
    ),
    Mistake("nothing to clean", "cotton3dg clean fresh", "not finished", (0, 2), may_change=("fresh/.lock",)),
    Mistake("a slash at the end", "cotton3dg run plant_1/", SILENT, (0,)),
    Mistake(
        "blanks and quotes in a name", """cotton3dg status "it's \\"plant\\" 1; rm" """, "traits", (0,),
        """mv plant_1 "it's \\"plant\\" 1; rm" """,
    ),
    Mistake("a link to a plant", CONTINUE, SILENT, (0,), "mkdir away; mv plant_1 away; ln -s away/plant_1 plant_1"),
    Mistake("a plant that was moved", "cotton3dg run away/plant_1", SILENT, (0,), "mkdir away; mv plant_1 away"),
    Mistake("a plant that was renamed", "cotton3dg status plant_7", "traits.*plant_id", (0,), "mv plant_1 plant_7"),
)  # fmt: skip
"""Commands at the wrong place or before their time."""

AGAIN: Final = (
    Mistake("a check of what is finished", "cotton3dg check plant_1", "plant_1", (0, 9), may_change=CHECKED),
    Mistake(
        "the same with other options", "cotton3dg check plant_1 --set frames.count=20", "plant_1", (0, 2, 4, 9),
        may_change=CHECKED,
    ),
    Mistake(
        "an option that is given once", f"{CONTINUE} && grep '\"table_length_cm\": 100' plant_1/records/scale.json",
        "table.length.cm", (0,),
        "grep -v table_ plant_1/cotton3dg.toml > x; mv x plant_1/cotton3dg.toml;"
        f" cotton3dg scale plant_1 --table-length-cm 100 --table-width-cm 50; {CONTINUE}",
    ),
    Mistake(
        "a plant of a field alone", "cotton3dg run field/plant_1; ! cotton3dg status field/plant_1 | grep stale",
        SILENT, (0,),
    ),
    Mistake(
        "a second comparison", "cotton3dg compare plant_1 field/plant_1", r"comparison", (0, 2),
        "cotton3dg compare plant_1 field/plant_1; mkdir -p comparison; echo mine > comparison/comparison.html",
        may_change=("comparison?2*",),
    ),
    Mistake(
        "a second repeat", "cotton3dg repeat plant_1 field/plant_1", r"repeat", (0, 2),
        "cotton3dg repeat plant_1 field/plant_1; mkdir -p repeat; echo mine > repeat/repeat.html",
        may_change=("repeat?2*",),
    ),
    Mistake("a report after clean", "cotton3dg report plant_1", SILENT, (0, 2), "cotton3dg clean plant_1"),
    Mistake(
        "an import twice", "cotton3dg import film.mp4 --into field_2 --names names.csv", "there", (0,),
        "printf 'file,plant_id\nfilm.mp4,p7\n' > names.csv; cotton3dg import film.mp4 --into field_2 --names names.csv",
        may_change=("field_2/import.csv",),
    ),
    Mistake("a boll that does not exist", "cotton3dg correct plant_1 --delete 99", "99.*(;|bolls)", (2, 8)),
    Mistake(
        "corrections of another plant", "cotton3dg correct plant_1 other.json", r"; \w", (2, 8),
        "cotton3dg correct field/plant_2 --delete 1; cp field/plant_2/corrections.json other.json",
    ),
    Mistake(
        "an export over one's notes", "cotton3dg export field", r"field\.xlsx.*; \w", (2,),
        "mkdir -p field/export/xlsx; echo mine > field/export/xlsx/field.xlsx",
    ),
    Mistake(
        "another film of the same name", "cotton3dg status plant_1", r"frames.*stale.*video\.mp4", (0,),
        "cp field/plant_2/video.mp4 plant_1/video.mp4",
    ),
    Mistake("a second film", CONTINUE, "several videos.*;", (2, 4), "cp film.mp4 plant_1/again.mp4"),
    Mistake("no film any more", CONTINUE, "no video.*;|up to date", (0, 2), "rm plant_1/video.mp4"),
    Mistake("frames that were deleted", "cotton3dg status plant_1", "frames.*stale", (0,), "rm -r plant_1/frames"),
    Mistake(
        "a model that was deleted", "cotton3dg render plant_1", "run `cotton3dg train", (2,),
        "rm plant_1/train/gaussians.ply",
    ),
    Mistake(
        "a table that was edited", "cotton3dg status plant_1", "traits.*stale", (0,),
        "echo mine >> plant_1/traits/traits.csv",
    ),
    Mistake(
        "a record that was cut short", "cotton3dg status plant_1", "sfm.*(stale|no finished|missing)", (0,),
        "head -c 100 plant_1/records/sfm.json > x; mv x plant_1/records/sfm.json",
    ),
)  # fmt: skip
"""Commands once more, on what was finished or changed by hand."""

FILES: Final = (
    Mistake("an emptied options file", "cotton3dg status plant_1", "changed.*steps", (0,), "> plant_1/cotton3dg.toml"),
    Mistake(
        "a file of options with a byte order mark", CONTINUE, SILENT, (0,),
        "printf '\\xef\\xbb\\xbf' | cat - plant_1/cotton3dg.toml > x; mv x plant_1/cotton3dg.toml",
    ),
    Mistake(
        "a file of options in UTF-16", CONTINUE, SILENT, (0,),
        "iconv -t UTF-16 plant_1/cotton3dg.toml > x; mv x plant_1/cotton3dg.toml", needs="command -v iconv",
    ),
    Mistake(
        "a key misspelt in a file", CONTINUE, r"cotton3dg\.toml.*did you mean.*steps", (2,),
        "sed s/^steps/stepps/ plant_1/cotton3dg.toml > x; mv x plant_1/cotton3dg.toml",
    ),
    Mistake(
        "what macOS leaves beside files", CONTINUE, SILENT, (0,),
        "for f in video.mp4 cotton3dg.toml; do echo 'Mac OS X' > plant_1/._$f; done; touch plant_1/.DS_Store",
    ),
    Mistake(
        "a truth with semicolons and decimal commas", "cotton3dg evaluate field/batch.csv --truth truth.csv",
        r"plant_height_cm +2\b", (0,),
        "printf 'plant_id;plant_height_cm\nplant_1;76,2\nplant_2;70,1\n' > truth.csv", may_change=("evaluation*",),
    ),
    Mistake(
        "a truth with units in its cells", "cotton3dg evaluate field/batch.csv --truth truth.csv", r"76\.2 cm.*; \w",
        (2, 4), "printf 'plant_id,plant_height_cm\nplant_1,76.2 cm\nplant_2,70 cm\n' > truth.csv",
    ),
    Mistake(
        "a cloud with intensities", "cotton3dg evaluate plant_1 --cloud cloud.xyz", r"boll.id.*; \w", (2, 4),
        "python -c 'for k in range(900): print(k % 30, k // 30, k % 7, k % 211 / 211)' > cloud.xyz",
    ),
    Mistake(
        "masks of 0 and 255", "cotton3dg masks plant_1 --backend import", "255|connected|piece", (0, 2, 4),
        "cd plant_1; mkdir own_masks; python -c 'import cv2, glob\nfor f in glob.glob(\"masks/*.png\"):"
        " cv2.imwrite(\"own_\" + f, 255 * (cv2.imread(f, -1) > 0).astype(\"uint8\"))'",
        may_change=(*TIMED, "plant_1/masks*"),
    ),
    Mistake(
        "boxes for outlines", "cotton3dg masks plant_1 --backend import", r"(box|outline|segmentation).*; \w", (2, 4),
        """mkdir plant_1/own_masks; echo '{"categories": [{"id": 1, "name": "boll"}], "images": [{"id": 1, "file_name":
        "000000.jpg", "width": 320, "height": 180}], "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox":
        [40, 50, 20, 20], "area": 400, "iscrowd": 0, "segmentation": []}]}' > plant_1/own_masks/bolls.json""",
    ),
    Mistake(
        "one film in two folders", "cotton3dg batch field", "same (film|video)", (0, 2, 8),
        "mkdir field/plant_3; cp field/plant_1/video.mp4 field/plant_3", may_change=(*BATCH, "field/plant_3*"),
    ),
    Mistake(
        "photos in HEIC", "cotton3dg frames photos", r"HEIC.*; \w", (2, 4),
        "mkdir -p photos/images; for k in 1 2 3; do printf '\\0\\0\\0\\x18ftypheic' > photos/images/$k.heic; done",
        may_change=("photos/*",),
    ),
)  # fmt: skip
"""Files as other programs and other people write them."""

MACHINES: Final = (
    Mistake(
        "two runs at once", CONTINUE, r"process \d+.*--wait", (3,), f"exec > /dev/null 2>&1; {TRAIN}{TRAINS}",
        "cotton3dg run plant_1 --wait", TIMED,
    ),
    Mistake("SIGTERM", f"{TRAIN}{TRAINS} kill -TERM $!; wait $!", "continues", (143,), "", CONTINUE, TIMED),
    Mistake(
        "Ctrl-C", f"set -m; {TRAIN} set +m; {TRAINS} kill -INT $!; wait $!", "continues", (130,), "", CONTINUE, TIMED
    ),
    Mistake("a power cut", f"{TRAIN}{TRAINS} kill -KILL $!; wait $!", SILENT, (137,), "", CONTINUE, TIMED),
    Mistake("a pipe that reads one line", "cotton3dg status plant_1 | head -n 1", SILENT, (0, 1, 141)),
    Mistake(
        "a full disk at the output", "cotton3dg status plant_1 > /dev/full", "space|full", (7,),
        needs="test -c /dev/full",
    ),
    Mistake(
        "a full disk while it saves", "ulimit -f 16; cotton3dg frames plant_1 --force", "disk|space", (7,), "",
        CONTINUE, TIMED,
    ),
    Mistake("no terminal at all", "cotton3dg run plant_1 <&- >&- 2>&-", SILENT, (0,)),
    Mistake("a read-only plant", CONTINUE, SILENT, (0, 3), "chmod -R a-w plant_1", needs=READ_ONLY),
    Mistake(
        "a read-only plant, by force", "cotton3dg run plant_1 --force", r"permission.*; \w", (3,),
        "chmod -R a-w plant_1", needs=READ_ONLY,
    ),
    Mistake(
        "a folder that cannot be read", "cotton3dg batch field", SILENT, (0, 8), "mkdir -m 0 field/lost+found",
        may_change=BATCH, needs="mkdir -m 0 probe; ! ls probe",
    ),
    Mistake(
        "a name that is not UTF-8", "cotton3dg batch field", "UTF-8|name", (0, 8),
        "mkdir field/$'plant_\\xff'; cp film.mp4 field/$'plant_\\xff'", may_change=(*BATCH, "field/*xff*"),
        needs="mkdir probe$'\\xff'",
    ),
    Mistake(
        "a file system without locks", f"LD_PRELOAD=$PWD/no_locks.so {CONTINUE}", SILENT, (0, 3),
        "printf '#include <errno.h>\nint flock(int f, int o) { errno = ENOLCK; return -1; }\n' > no_locks.c;"
        " cc -shared -fPIC -o no_locks.so no_locks.c",
        needs="test $(uname) = Linux && command -v cc",
    ),
    Mistake(
        "a working folder that is gone", 'cd gone; rmdir ../gone; cotton3dg status "$OLDPWD/plant_1"', "traits|;",
        (0, 2, 3), "mkdir gone", may_change=("gone",),
    ),
    Mistake(
        "a plain, narrow terminal", f"TERM=dumb NO_COLOR=1 COLUMNS=20 LC_ALL=C {CONTINUE} --dry-run", "traits|date",
        (0,),
    ),
    Mistake("no home", f"HOME=/proc/none {CONTINUE} --no-report", SILENT, (0,)),
)  # fmt: skip
"""Accidents of the machine."""

MISTAKES: Final = (*TYPED, *PLACES, *AGAIN, *FILES, *MACHINES)
