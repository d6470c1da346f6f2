# SPDX-License-Identifier: Apache-2.0
"""Which modules of the package the tests use in place of the installed ones.

COTTON3DG_REPLACED names them as module=file, separated by colons. `make sanitize` and tests/hard_cases/mutations.py
test other builds of the core and changed sources this way.
"""

import importlib
import importlib.util
import os
import sys

for pair in filter(None, os.environ.get("COTTON3DG_REPLACED", "").split(":")):
    name, path = pair.split("=")
    parent, child = name.rsplit(".", 1)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec and spec.loader, pair
    package, module = importlib.import_module(parent), importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    setattr(package, child, module)
