# SPDX-License-Identifier: Apache-2.0
"""The network that comes with the program: gone, or not what it was."""

import shutil

import pytest

from cotton3dg.errors import EnvironmentUnusable
from cotton3dg.masks.bolls import SHIPPED_FILE
from cotton3dg.masks.weight_files import read_shipped


def test_shipped_weights_that_are_gone_or_damaged_name_the_remedy(tmp_path):
    whole, copy = SHIPPED_FILE.read_bytes(), tmp_path / SHIPPED_FILE.name
    shutil.copy(SHIPPED_FILE.with_name(f"{SHIPPED_FILE.name}.sha256"), tmp_path)
    with pytest.raises(EnvironmentUnusable, match="is not there; install cotton3dg again"):
        read_shipped(copy)
    copy.write_bytes(whole[:1000])
    with pytest.raises(EnvironmentUnusable, match="is damaged; install cotton3dg again"):
        read_shipped(copy)
    copy.write_bytes(whole)
    assert read_shipped(copy) == whole
