# SPDX-License-Identifier: Apache-2.0
"""What the tests of the core share."""

import pytest

from cotton3dg import _native


@pytest.fixture(params=_native.instruction_sets())
def instruction_set(request):
    chosen = _native.instruction_set()
    _native.use_instruction_set(request.param)
    yield request.param
    _native.use_instruction_set(chosen)
