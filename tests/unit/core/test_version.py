# SPDX-License-Identifier: Apache-2.0
"""The version names its commit."""

import shutil
import subprocess

from cotton3dg import __version__
from cotton3dg.core.version import version_text


def test_the_version_names_the_commit_of_a_wheel_or_of_a_checkout(tmp_path):
    package = tmp_path / "cotton3dg"
    package.mkdir()
    assert version_text(package) == __version__
    (tmp_path / ".git").mkdir()  # of no use to git
    assert version_text(package) == __version__
    shutil.rmtree(tmp_path / ".git")
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.example"]
    for words in (["init", "-q"], ["commit", "-q", "--allow-empty", "-m", "first"]):
        subprocess.run([*git, *words], check=True)
    head = subprocess.check_output([*git, "rev-parse", "--short", "HEAD"], text=True).strip()
    assert version_text(package) == f"{__version__} (commit {head})"
    (package / "COMMIT").write_text("abc1234\n")
    assert version_text(package) == f"{__version__} (commit abc1234)"
