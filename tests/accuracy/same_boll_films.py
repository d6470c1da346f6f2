# SPDX-License-Identifier: Apache-2.0
"""The films of `same_boll.py`: options of `cotton3dg simulate` by plant, a kind of bolls and a number.

Their seeds are not those of the study (`study_set`).
"""

from __future__ import annotations

from study_set import HALF_TOUCH, LARGE

FILM = "--width 960 --height 540 --frames 62 --supersampling 1"
SMALL = "--width 640 --height 360 --frames 60 --supersampling 1"
FITTED = {
    "separate-1": "--seed 9201 --bolls 14 --boll-kind separate --clustered 0.5 --contact 0.85 --one-sided"
    " --width 800 --height 450 --frames 60",
    "separate-2": f"--seed 9202 --bolls 16 --boll-kind separate --things 6 {FILM}",
    "separate-3": f"--seed 9203 --bolls 18 --boll-kind separate --clustered 0.7 --contact 0.8 {SMALL}",
    "separate-5": f"--seed 9302 --bolls 15 --boll-kind separate --clustered 0.5 --contact 0.8 {SMALL}",
    "separate-6": f"--seed 9310 --bolls 17 --boll-kind separate --clustered 0.6 --contact 0.85 --noise 3 {FILM}",
    "separate-7": f"--seed 9315 --bolls 18 --boll-kind separate --things 5 {SMALL}",
    "touching-1": f"--seed 9101 --bolls 16 --clustered 0.85 --contact 0.72 {FILM}",
    "touching-2": f"--seed 9110 --bolls 20 --clustered 0.85 --contact 0.75 {SMALL}",
    "touching-3": f"--seed 9111 --bolls 14 --clustered 0.85 --contact 0.72 {FILM}",
    "touching-4": f"--seed 9301 --bolls 18 --clustered 0.85 --contact 0.75 {FILM}",
    "touching-5": f"--seed 9303 --bolls 15 --clustered 0.85 --contact 0.7 {SMALL}",
    "touching-6": f"--seed 9306 --bolls 20 --boll-kind usual --clustered 0.85 --contact 0.72 {FILM}",
    "touching-7": f"--seed 9309 --bolls 17 --clustered 0.85 --contact 0.75 {FILM}",
    "plain-1": f"--seed 9108 --bolls 20 --clustered 0.4 {FILM}",
    "usual-1": f"--seed 9102 --bolls 14 --boll-kind usual --clustered 0.6 --contact 0.85 --things 5 {FILM}",
    "usual-2": f"--seed 9115 --bolls 18 --boll-kind usual --one-sided --noise 4 {FILM}",
    "fluffy-1": f"--seed 9103 --bolls 14 --boll-kind fluffy --clustered 0.6 --contact 0.8 {SMALL}",
    "fluffy-2": f"--seed 9113 --bolls 14 --boll-kind fluffy --clustered 0.85 --contact 0.72 {FILM}",
    "fluffy-3": f"--seed 9311 --bolls 16 --boll-kind fluffy --clustered 0.4 --contact 0.85 {FILM}",
    "hanging-1": "--seed 9104 --bolls 12 --boll-kind hanging --one-sided --width 1280 --height 720",
    "hanging-2": f"--seed 9114 --bolls 13 --boll-kind hanging --clustered 0.4 --contact 0.85 {FILM}",
    "hanging-3": f"--seed 9304 --bolls 15 --boll-kind hanging --clustered 0.5 --contact 0.85 {SMALL}",
    "hanging-4": f"--seed 9307 --bolls 16 --boll-kind separate --hanging 0.5 {FILM}",
    "hanging-5": f"--seed 9316 --bolls 14 --boll-kind hanging --things 4 {FILM}",
    "torn-1": f"--seed 9105 --bolls 13 --boll-kind torn --one-sided --things 6 --noise 4 {SMALL}",
    "torn-2": f"--seed 9305 --bolls 15 --boll-kind torn --clustered 0.5 --contact 0.85 {FILM}",
    "torn-3": f"--seed 9308 --bolls 17 --boll-kind torn --things 4 {SMALL}",
    "half_open-1": f"--seed 9106 --bolls 15 --boll-kind half_open --clustered 0.4 --contact 0.85 --things 5 {SMALL}",
    "half_open-2": f"--seed 9312 --bolls 18 --boll-kind half_open --clustered 0.7 --contact 0.75 {FILM}",
}
JUDGED = {
    "drooping-1": f"--seed 9107 --bolls 14 --boll-kind drooping --clustered 0.5 --contact 0.85 --one-sided {SMALL}",
    "drooping-2": f"--seed 9116 --bolls 16 --boll-kind drooping --things 5 {FILM}",
    "drooping-3": f"--seed 9314 --bolls 16 --boll-kind drooping --clustered 0.5 --contact 0.8 {FILM}",
    "tight-1": f"--seed 9109 --bolls 14 --boll-kind tight --dark 1 --clustered 0.5 --contact 0.8 {SMALL}",
    "tight-2": f"--seed 9313 --bolls 18 --boll-kind tight --clustered 0.85 --contact 0.72 {FILM}",
    "natural-1": f"--seed 9112 --architecture natural --vegetative 1 --barren 0.25 --boll-kind usual {FILM}",
    "separate-4": f"--seed 9204 --bolls 15 --boll-kind separate --clustered 0.4 --noise 4 --dark 0.7 {FILM}",
    "touching-8": f"--seed 651 --bolls 15 --clustered 0.85 --contact 0.72 {LARGE}",
    "touching-9": f"--seed 652 --bolls 19 --clustered 0.85 --contact 0.72 {LARGE}",
    "touching-10": f"--seed 653 --bolls 23 --clustered 0.85 --contact 0.72 {LARGE}",
    "touching-11": f"--seed 654 --bolls 26 --clustered 0.85 --contact 0.72 {LARGE}",
    "drooping-4": f"--seed 7501 --bolls 14 --boll-kind drooping {HALF_TOUCH} {LARGE}",
    "drooping-5": f"--seed 7502 --bolls 18 --boll-kind drooping --one-sided --things 4 {LARGE}",
    "separate-8": f"--seed 7503 --bolls 16 --boll-kind separate {HALF_TOUCH} {LARGE}",
    "separate-9": f"--seed 7504 --bolls 18 --boll-kind separate --things 5 {LARGE}",
    "hanging-6": f"--seed 7505 --bolls 15 --boll-kind hanging --one-sided {HALF_TOUCH} {LARGE}",
    "torn-4": f"--seed 7506 --bolls 16 --boll-kind torn {HALF_TOUCH} --one-sided {LARGE}",
    "usual-3": f"--seed 7507 --bolls 18 --boll-kind usual --clustered 0.85 --contact 0.72 {LARGE}",
    "fluffy-4": f"--seed 7508 --bolls 16 --boll-kind fluffy {HALF_TOUCH} {LARGE}",
}
"""Never fitted to: kinds that the fit does not have, and other plants of those that it has."""
