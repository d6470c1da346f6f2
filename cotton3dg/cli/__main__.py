# SPDX-License-Identifier: Apache-2.0
"""`python -m cotton3dg.cli` does what the console script does."""

from .app import main

main()
