# SPDX-License-Identifier: Apache-2.0
"""Python that finds this file at its start has an OpenCV without optimised paths, once it imports it."""

import importlib.abc
import importlib.util
import sys


class _Plain(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name != "cv2":
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec and spec.loader:
            load = spec.loader.exec_module

            def exec_module(module):
                load(module)
                module.setUseOptimized(False)

            spec.loader.exec_module = exec_module
        return spec


sys.meta_path.insert(0, _Plain())
