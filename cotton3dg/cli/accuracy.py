# SPDX-License-Identifier: Apache-2.0
"""Commands about accuracy: against a truth, and against time; parse, call, print, no logic."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from ..command_options import CM_PER_UNIT
from ..errors import BadUsage, MissingInput, unknown
from .arguments import AsJson, Loud, OwnPreset, PlantDir, Set, TimeBudget, choice, given, parse_overrides, report_errors


def evaluate(
    measured: Annotated[Path, given(help="folder of a finished plant, or a table of plants or bolls (.csv)")],
    truth: Annotated[Path | None, typer.Option(help="truth.json, default: the plant's; of a table, a table")] = None,
    masks: Annotated[Path | None, typer.Option(help="folder of true masks; only the masks are judged")] = None,
    cloud: Annotated[Path | None, typer.Option(help="point cloud as truth, z up (.ply, .pcd, .xyz)")] = None,
    cloud_unit: Annotated[str, choice("--cloud-unit", known=CM_PER_UNIT, help="of the cloud", default="m")] = "m",
    out: Annotated[Path, typer.Option(help="folder for scores and plots of tables, and for masks.csv")] = Path(
        "evaluation"
    ),
    as_json: AsJson = False,
) -> None:
    """Print measured values beside the true ones: of a plant's traits and bolls, or of many plants with plots."""
    from ..evaluation.mask_table import add_to_table
    from ..evaluation.masks import MaskCounts, evaluate_masks
    from ..evaluation.plant import evaluate_cloud
    from ..evaluation.tables import (
        evaluate_boll_tables,
        evaluate_tables,
        evaluation_text,
        is_boll_table,
        write_evaluation,
    )
    from ..outputs import made_of, saving
    from ..plants import plant_at
    from . import display

    with report_errors(measured):
        if measured.is_file():
            if truth is None:
                raise BadUsage("the table of the truth is not given; add --truth TRUTH.csv")
            of_bolls = is_boll_table(measured)
            evaluation = evaluate_boll_tables(measured, truth) if of_bolls else evaluate_tables(measured, truth)
            with saving(out, made_of("evaluate", measured, truth)) as folder:
                write_evaluation(folder, evaluation)
            if as_json:
                display.print_json(asdict(evaluation))
            else:
                typer.echo(f"{evaluation_text(evaluation)}\nsaved in {out}")
            return
        workspace = plant_at(measured)
        if masks:
            counts, record = evaluate_masks(workspace, masks), workspace.read_record("masks")
            add_to_table(out / "masks.csv", workspace.plant_id, record.options["backend"] if record else "", counts)
            display.print_mask_scores(sum(counts.values(), MaskCounts()), len(counts), as_json=as_json)
            typer.echo(f"saved in {out / 'masks.csv'}", err=as_json)
        elif cloud:
            if cloud_unit not in CM_PER_UNIT:
                raise unknown(f"--cloud-unit {cloud_unit}", cloud_unit, CM_PER_UNIT)
            display.print_evaluation(evaluate_cloud(workspace, cloud, CM_PER_UNIT[cloud_unit]), as_json=as_json)
        else:
            display.print_comparison(workspace, truth or workspace.truth_json, as_json=as_json)


def evaluate_weights(
    measured: Annotated[Path, typer.Argument(help="table of many plants, as batch.csv")],
    truth: Annotated[Path | None, typer.Option(help="table with boll_weight_g; default: the same table")] = None,
    out: Annotated[Path, typer.Option(help="folder for weights.json and the plots")] = Path("evaluation"),
) -> None:
    """Fit seed-cotton weight by boll volume and count to weighed plants, for traits --weight-model."""
    from ..evaluation.weights import fit_weights, weights_text, write_weights
    from ..outputs import made_of, saving

    with report_errors(measured):
        model, points = fit_weights(measured, truth or measured)
        with saving(out, made_of("evaluate-weights", measured, truth or measured)) as saved:
            write_weights(saved, model, points)
        typer.echo(f"{weights_text(model)}\nsaved as {out / 'weights.json'}")


def study(
    plant_dir: PlantDir,
    sweep: Annotated[
        list[str] | None, typer.Option(metavar="NAME[=VALUE,...]", help="what to vary, or all; repeatable")
    ] = None,
    preset: OwnPreset = "draft",
    time_budget: TimeBudget = None,
    truth: Annotated[Path | None, typer.Option(help="truth.json, default: the plant's")] = None,
    standard: Annotated[bool, typer.Option("--standard", help="on a simulated plant, made in the folder")] = False,
    lpips: Annotated[Path | None, typer.Option(help="network of LPIPS, TorchScript; none = no LPIPS")] = None,
    local: Annotated[Path | None, typer.Option(help="the same plant filmed close by, for the sweep style")] = None,
    set_: Set = None,
    loud: Loud = None,
) -> None:
    """Try settings side by side on a plant: what accuracy costs in time, as tables and a picture; it resumes."""
    from ..commands.simulate import STANDARD_PLANT, film_once
    from ..options import resolve
    from ..planning.tradeoff import parse_duration
    from ..plants import plant_at
    from ..study.settings import sweeps_of
    from ..study.tables import summary
    from ..study.work import Study
    from ..workspace import Workspace
    from . import progress

    with report_errors(plant_dir), progress.ProgressDisplay(loud) as watcher:
        sweeps, budget_s = sweeps_of(sweep), parse_duration(time_budget or "1000h")
        if standard:
            film_once(plant_dir, resolve("simulate", STANDARD_PLANT), watcher.watched("simulate"))
        plant = plant_at(plant_dir)
        if lpips and not lpips.is_file():
            raise MissingInput(f"{lpips} is not there; docs/papers.md says how to make the network of LPIPS")
        work = Study(
            plant,
            preset,
            parse_overrides(set_),
            budget_s=budget_s,
            truth_json=truth,
            lpips=lpips,
            local=Workspace(local) if local else None,
            watcher=watcher,
            tell=watcher.say,
        )
        found = work.run(sweeps)
    typer.echo(f"{summary(found)}\nsaved in {plant.study_csv.parent}")
