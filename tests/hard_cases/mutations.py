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

from scratch_build import ROOT, Change, build

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
    """Of native/src, or of the package where the file is a .py below cotton3dg."""
    tests: tuple[str, ...] = CORE


MUTATIONS = (
    Mutation("alpha cap of 0.999 backward only", ((
        "rasterize.cpp",
        "                const Blend<Real>& b = blends[block];\n",
        "                Blend<Real> b = blends[block];\n"
        "                for (int j = 0; j < kVectors<Real>; ++j) {\n"
        "                    b.weight[j] *= b.alpha[j] < Real(kAlphaCap) ? V{} + 1 : V{} + Real(0.999 / kAlphaCap);\n"
        "                }\n",
    ),)),
    Mutation("parameters that are not finite are not culled", ((
        "project.cpp", "if (!(not_finite[lane] == 0)) {", "if (false) {"
    ),)),
    Mutation("colours that are not finite are not culled", (("project.cpp", "return usable;", "return true;"),)),
    Mutation("sort that is not stable", (("frame.cpp", "rows[i] = visible[i];", "rows[i] = visible[n - 1 - i];"),)),
    Mutation("3-sigma cut", ((
        "project.cpp",
        "const Pack reach = sqrt(maximum(cut2, Pack{}) / kScale2);",
        "const Pack reach = minimum(sqrt(maximum(cut2, Pack{}) / kScale2), Pack{} + 3.0);",
    ),)),
    Mutation("sum that depends on the threads", ((
        "train.cpp",
        "for (const LossSums& sum : sums) report.l1 += sum.l1 * norm, report.ssim += sum.ssim * norm;",
        "std::vector<LossSums> parts(size_t(thread_count(threads)), LossSums{0, 0});\n"
        "    for (size_t i = 0; i < sums.size(); ++i) {\n"
        "        LossSums& part = parts[i % parts.size()];\n"
        "        part.l1 += sums[i].l1 * norm, part.ssim += sums[i].ssim * norm;\n"
        "    }\n"
        "    for (const LossSums& part : parts) report.l1 += part.l1, report.ssim += part.ssim;",
    ),)),
    Mutation("saturated alpha passes gradient", ((
        "rasterize.cpp", "b.alpha[j] < Real(kAlphaCap) ? fnma(odds, rest, here) : V{}", "fnma(odds, rest, here)"
    ),)),
    Mutation("determinant as ac - b²", ((
        "geometry.h",
        "f.det = m0 * m0 + m1 * m1 + m2 * m2 + kDilation * (a + c) + kDilation * kDilation;",
        "(void)m0, (void)m1, (void)m2, f.det = f.xx * f.yy - f.xy * f.xy;",
    ),)),
    Mutation("rejected step that is taken", ((
        "bindings_train.cpp", "if (gradient.finite) adam_step", "adam_step"
    ),), ("tests/hard_cases/test_resume.py",)),
    Mutation("probability that is not clamped", ((
        "cotton3dg/lifting/probability.py",
        "    held = np.clip(probability_map, MAP_MARGIN, 1 - MAP_MARGIN)",
        "    held = probability_map",
    ),), ("tests/unit/test_probability.py",)),
    Mutation("probability that is not clamped after the step", ((
        "cotton3dg/lifting/probability.py",
        "        np.clip(probabilities, 0, 1, out=probabilities)",
        "        pass",
    ),), ("tests/unit/test_probability.py",)),
    Mutation("joggled hull", ((
        "cotton3dg/geometry/convex_measures.py",
        "    return Measured(float(ConvexHull(centred).volume))",
        "    return Measured(float(ConvexHull(centred, qhull_options=\"QJ\").volume))",
    ), (
        "cotton3dg/geometry/convex_measures.py",
        '    """Volume of the convex hull of (N, 3) points."""\n'
        "    centred, reason = solid_points(points)\n    if reason:\n        return Measured(np.nan, reason)\n",
        '    """Volume of the convex hull of (N, 3) points."""\n'
        "    centred = np.asarray(points, np.float64)\n",
    )), ("tests/hard_cases/test_geometry.py",)),
    Mutation("checkpoint without the optimiser", ((
        "cotton3dg/files/checkpoint.py",
        'arrays: dict[str, NDArray[Any]] = {"adam_steps": adam.steps}',
        'arrays: dict[str, NDArray[Any]] = {"adam_steps": adam.steps * 0}',
    ),), ("tests/hard_cases/test_resume.py",)),
)  # fmt: skip


def replaced(mutation: Mutation) -> str:
    """The changed module, as tests/conftest.py takes it."""
    name = mutation.changes[0][0]
    if not name.endswith(".py"):
        return f"cotton3dg._native={build(FOLDER, changes=mutation.changes)}"
    text = (ROOT / name).read_text(encoding="utf-8")
    for _, old, new in mutation.changes:
        if text.count(old) != 1:
            raise ValueError(f"{name} has {text.count(old)} times, not once: {old}")
        text = text.replace(old, new)
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
