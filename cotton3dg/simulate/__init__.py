# SPDX-License-Identifier: Apache-2.0
"""A procedural cotton plant filmed by a virtual smartphone, with exact truth."""
