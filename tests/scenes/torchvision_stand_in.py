# SPDX-License-Identifier: Apache-2.0
"""torchvision for tests: the real one where it loads, else as much of it as ultralytics asks for with these models.

An index may have torch for processors and torchvision only for CUDA, and these two do not load together.
"""

import sys
import types


def provide() -> None:
    """Make `import torchvision` work."""
    try:
        import torchvision  # noqa: F401
    except (ImportError, RuntimeError):
        from ultralytics.utils.nms import TorchNMS

        for name in [name for name in sys.modules if name.partition(".")[0] == "torchvision"]:
            del sys.modules[name]
        module, ops = types.ModuleType("torchvision"), types.ModuleType("torchvision.ops")
        ops.nms = TorchNMS.nms  # type: ignore[attr-defined]
        module.ops, module.__version__ = ops, "0"  # type: ignore[attr-defined]
        sys.modules.update({"torchvision": module, "torchvision.ops": ops})
