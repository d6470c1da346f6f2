# SPDX-License-Identifier: Apache-2.0
"""Genotypes compared, against statsmodels and against what was put in."""

import numpy as np
import pandas as pd
import pytest

from cotton3dg.field.columns import book_cells, find_roles, table_columns
from cotton3dg.field.genotypes import compare, compare_genotypes
from cotton3dg.io.fieldbook import FieldBook


def trial(genotypes=30, blocks=4, of_genotype=4.0, of_block=3.0, of_plant=4.0, seed=0):
    rng = np.random.default_rng(seed)
    g, b = (part.ravel() for part in np.meshgrid(np.arange(genotypes), np.arange(blocks), indexing="ij"))
    effects, shifts = rng.normal(0, of_genotype, genotypes), rng.normal(0, of_block, blocks)
    values = 50 + effects[g] + shifts[b] + rng.normal(0, of_plant, len(g))
    labels = np.array([f"G{k:03d}" for k in range(genotypes)])[g]
    return values, {"genotype": labels, "block": b.astype(str)}, effects + 50 + shifts.mean()


def test_means_f_and_p_are_those_of_statsmodels():
    import statsmodels.formula.api as smf
    from statsmodels.stats.anova import anova_lm

    values, factors, _ = trial(8)
    kept = np.random.default_rng(1).random(len(values)) > 0.2  # unequal numbers
    values, factors = values[kept], {name: labels[kept] for name, labels in factors.items()}
    means, fit = compare("t", values, factors)
    table = anova_lm(smf.ols("y ~ C(genotype) + C(block)", pd.DataFrame({"y": values, **factors})).fit(), typ=2)
    assert fit.f_genotype == pytest.approx(table.loc["C(genotype)", "F"])
    assert fit.p_genotype == pytest.approx(table.loc["C(genotype)", "PR(>F)"])
    # The adjusted mean is what the model says of the genotype in each block, averaged over blocks.
    model = smf.ols("y ~ C(genotype) + C(block)", pd.DataFrame({"y": values, **factors})).fit()
    for mean in means:
        cells = pd.DataFrame({"genotype": mean.genotype, "block": sorted(set(factors["block"]))})
        assert mean.adjusted_mean == pytest.approx(model.predict(cells).mean())
        weights = {"Intercept": 1.0, f"C(genotype)[T.{mean.genotype}]": 1.0}
        weights |= {f"C(block)[T.{block}]": 1 / 4 for block in "123"}
        contrast = np.array([weights.get(name, 0.0) for name in model.params.index])
        assert mean.standard_error == pytest.approx(np.sqrt(contrast @ model.cov_params().to_numpy() @ contrast))


def test_heritability_is_what_was_put_in():
    values, factors, truth = trial(120, 4)
    means, fit = compare("t", values, factors)
    assert fit.variance_genotype == pytest.approx(16, rel=0.3)
    assert fit.variance_residual == pytest.approx(16, rel=0.2)
    assert fit.heritability == pytest.approx(16 / (16 + 16 / 4), abs=0.06)
    assert fit.p_genotype < 1e-6
    assert np.corrcoef([mean.adjusted_mean for mean in means], truth)[0, 1] > 0.85
    balanced, plain = compare("t", values, {"genotype": factors["genotype"]})
    assert [m.mean for m in balanced] == pytest.approx([m.adjusted_mean for m in means])
    assert plain.model == "genotype" and fit.model == "genotype + block"


def test_no_genetic_variance_is_none():
    values, factors, _ = trial(60, 3, of_genotype=0.0)
    _, fit = compare("t", values, factors)
    assert fit.heritability < 0.25
    assert fit.p_genotype > 0.01


def test_one_plant_each_and_equal_values_have_means_without_errors():
    means, fit = compare("t", np.array([1.0, 2.0, 4.0]), {"genotype": np.array(["a", "b", "c"])})
    assert [mean.adjusted_mean for mean in means] == pytest.approx([1, 2, 4])
    assert np.isnan([mean.standard_error for mean in means]).all()
    assert np.isnan([fit.f_genotype, fit.p_genotype, fit.heritability]).all()
    _, same = compare("t", np.full(4, 3.0), {"genotype": np.array(["a", "a", "b", "b"])})
    assert np.isnan(same.heritability)
    # A block that holds one genotype alone cannot be told from it; nothing breaks.
    factors = {"genotype": np.array(["a", "a", "b", "b"]), "block": np.array(["1", "1", "2", "2"])}
    means, fit = compare("t", np.array([1.0, 1.1, 2.0, 2.2]), factors)
    assert np.isnan(fit.f_genotype) and len(means) == 2


def test_rows_of_a_batch():
    rows = [
        {"Variety": variety, "boll_count": count, "plant_height_cm": height}
        for variety, count, height in (("x", 10, 70.0), ("x", 12, None), ("y", 20, 80.0), ("y", 21, ""), ("", 5, 9.0))
    ]
    means, fits = compare_genotypes(rows, ["Variety"])
    assert {fit.trait for fit in fits} == {"boll_count", "plant_height_cm"}
    assert {(mean.genotype, mean.mean) for mean in means if mean.trait == "boll_count"} == {("x", 11), ("y", 20.5)}
    assert compare_genotypes(rows, ["boll_count"]) == ([], [])


def test_columns_of_the_field_book():
    assert find_roles(["Plot ID", "Line", "REP", "notes"]) == {"genotype": "Line", "block": "REP", "plot": "Plot ID"}
    book = FieldBook("plant_id", ("genotype", "plant_height_cm"), {"A": {"genotype": "=x", "plant_height_cm": "-1.5"}})
    columns = table_columns(book, {"plant_height_cm"})
    assert [column.name for column in columns.values()] == ["genotype", "fieldbook_plant_height_cm"]
    assert book_cells(book, "A", columns) == {"genotype": "=x", "fieldbook_plant_height_cm": -1.5}
    assert book_cells(book, "B", columns) == {"genotype": "", "fieldbook_plant_height_cm": ""}
    assert table_columns(None, ()) == {}
