"""Which build of the native core the tests use: the installed one, or the file named by COTTON3DG_NATIVE.

`make sanitize` and tests/hard_cases/mutations.py test other builds of it this way.
"""

import importlib.util
import os
import sys

if path := os.environ.get("COTTON3DG_NATIVE"):
    spec = importlib.util.spec_from_file_location("cotton3dg._native", path)
    assert spec and spec.loader, path
    sys.modules["cotton3dg._native"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["cotton3dg._native"])
