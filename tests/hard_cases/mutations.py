# SPDX-License-Identifier: Apache-2.0
"""Bring back known bugs, one at a time, and show which tests notice.

    python tests/hard_cases/mutations.py [part of a name ...]

Each bug is a small change of the sources, built and tested apart from the installed package. One that no test notices
is an error.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "native"))

from scratch_build import build
from source_changes import ROOT, Change, apply_change

FOLDER = ROOT / "build" / "mutations"
CORE = (
    "tests/hard_cases/test_core_blending.py",
    "tests/property/test_relations.py",
    "tests/hard_cases/test_core_projection.py",
    "tests/native/test_gradients.py",
)


@dataclass(frozen=True)
class Mutation:
    """A bug as others have had it."""

    name: str
    changes: tuple[Change, ...]
    """Of the core or of one module of the package."""
    tests: tuple[str, ...] = CORE


MUTATIONS = (
    Mutation("alpha cap of 0.999 backward only", (Change(
        "rasterize.h", "backward",
        "const Blend<Real>& @blend = @blends[@block];",
        "Blend<Real> @blend = @blends[@block];\n"
        "for (int j = 0; j < kVectors<Real>; ++j) {\n"
        "    @blend.weight[j] *= @blend.alpha[j] < Real(kAlphaCap) ? V{} + 1 : V{} + Real(0.999 / kAlphaCap);\n"
        "}",
    ),)),
    Mutation("parameters that are not finite are not culled", (Change(
        "project.h", "project", "!(@flags[@lane] == 0) ? kNonFinite", "false ? kNonFinite"
    ),)),
    Mutation("colours that are not finite are not culled", (Change(
        "project.h", "write_values", "return @usable;", "return true;"
    ),)),
    Mutation("sort that is not stable", (Change(
        "frame.cpp", "sort_by_depth", "@rows[@i] = visible[@i];", "@rows[@i] = visible[visible_count - 1 - @i];"
    ),)),
    Mutation("3-sigma cut", (Change(
        "project.h", "project",
        "sqrt(maximum(@cut2, Pack{}) / kScale2)",
        "minimum(sqrt(maximum(@cut2, Pack{}) / kScale2), Pack{} + 3.0)",
    ),)),
    Mutation("sum that depends on the threads", (Change(
        "loss.cpp", "image_loss",
        "for (const LossSums& @sum : @sums) @report.l1 += @sum.l1 * @norm, @report.ssim += @sum.ssim * @norm;",
        "std::vector<LossSums> parts(size_t(thread_count(threads)), LossSums{0, 0});\n"
        "for (size_t i = 0; i < @sums.size(); ++i) {\n"
        "    LossSums& part = parts[i % parts.size()];\n"
        "    part.l1 += @sums[i].l1 * @norm, part.ssim += @sums[i].ssim * @norm;\n"
        "}\n"
        "for (const LossSums& part : parts) @report.l1 += part.l1, @report.ssim += part.ssim;",
    ),)),
    Mutation("saturated alpha passes gradient", (Change(
        "rasterize.h", "backward",
        "@blend.alpha[@j] < Real(kAlphaCap) ? fnma(@odds, @rest, @here) : V{}",
        "fnma(@odds, @rest, @here)",
    ),)),
    Mutation("determinant as ac - b²", (Change(
        "geometry.h", "footprint",
        "@f.det = @a * @a + @b * @b + @c * @c + kDilation * (@xx + @yy) + kDilation * kDilation;",
        "(void)@a, (void)@b, (void)@c, @f.det = @f.xx * @f.yy - @f.xy * @f.xy;",
    ),)),
    Mutation("rejected step that is taken", (Change(
        "bindings_train.cpp", "train_step", "if (@gradient.finite) adam_step", "adam_step"
    ),), ("tests/hard_cases/test_resume.py",)),
    Mutation("probability that is not clamped", (Change(
        "cotton3dg/segment/probability.py", "cross_entropy_gradient",
        "np.clip(@map, MAP_MARGIN, 1 - MAP_MARGIN)", "@map",
    ),), ("tests/unit/segment/test_probability.py",)),
    Mutation("probability that is not clamped after the step", (Change(
        "cotton3dg/segment/probability.py", "train_probabilities",
        "np.clip(@probabilities, 0, 1, out=@probabilities)", "pass",
    ),), ("tests/unit/segment/test_probability.py",)),
    Mutation("joggled hull", (Change(
        "cotton3dg/geometry/convex_measures.py", "convex_volume",
        "ConvexHull(@points)", 'ConvexHull(@points, qhull_options="QJ")',
    ), Change(
        "cotton3dg/geometry/convex_measures.py", "convex_volume", "if @reason: return Measured(np.nan, @reason)", ""
    )), ("tests/hard_cases/test_geometry.py",)),
    Mutation("checkpoint without the optimiser", (Change(
        "cotton3dg/train/checkpoint.py", "write_training", '"adam_steps": @adam.steps', '"adam_steps": @adam.steps * 0'
    ),), ("tests/hard_cases/test_resume.py",)),
)  # fmt: skip


def replaced(mutation: Mutation) -> str:
    """The changed module, as tests/conftest.py takes it."""
    name, path = mutation.changes[0].file, mutation.changes[0].path
    if not name.endswith(".py"):
        return f"cotton3dg._native={build(FOLDER, changes=mutation.changes)}"
    text = path.read_text(encoding="utf-8")
    for change in mutation.changes:
        text = apply_change(text, change)
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / Path(name).name).write_text(text, encoding="utf-8")
    return f"{name.removesuffix('.py').replace('/', '.')}={FOLDER / Path(name).name}"


def noticed_by(mutation: Mutation) -> list[str]:
    """Test functions that fail with the bug, of the first four failures."""
    environment = os.environ | {"COTTON3DG_REPLACED": replaced(mutation), "COTTON3DG_SCENES": "100"}
    command = [sys.executable, "-m", "pytest", "-q", "--no-header", "-rfE", "--tb=no", "--maxfail=4", *mutation.tests]
    done = subprocess.run(command, check=False, cwd=ROOT, env=environment, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(f"the tests did not run: {done.stdout[-500:]}{done.stderr[-500:]}")
    return sorted(set(re.findall(r"^(?:FAILED|ERROR) \S+::(\w+)", done.stdout, re.MULTILINE)))


if __name__ == "__main__":
    silent = 0
    for mutation in MUTATIONS:
        if not sys.argv[1:] or any(part in mutation.name for part in sys.argv[1:]):
            tests = noticed_by(mutation)
            silent += not tests
            print(f"{mutation.name}: {'noticed by ' + ', '.join(tests) if tests else 'NOT NOTICED'}", flush=True)
    sys.exit(silent > 0)
