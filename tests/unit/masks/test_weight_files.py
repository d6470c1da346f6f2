"""The networks that come with the program: gone, or not what they were."""

import shutil

import pytest

from cotton3dg.errors import EnvironmentUnusable
from cotton3dg.masks.bolls import SHIPPED_FILE
from cotton3dg.masks.lint_edges import EDGES_FILE
from cotton3dg.masks.weight_files import read_shipped


@pytest.mark.parametrize("file", [SHIPPED_FILE, EDGES_FILE])
def test_shipped_weights_that_are_gone_or_damaged_name_the_remedy(tmp_path, file):
    whole, copy = file.read_bytes(), tmp_path / file.name
    shutil.copy(file.with_name(f"{file.name}.sha256"), tmp_path)
    with pytest.raises(EnvironmentUnusable, match="is not there; install cotton3dg again"):
        read_shipped(copy)
    copy.write_bytes(whole[:1000])
    with pytest.raises(EnvironmentUnusable, match="is damaged; install cotton3dg again"):
        read_shipped(copy)
    copy.write_bytes(whole)
    assert read_shipped(copy) == whole
