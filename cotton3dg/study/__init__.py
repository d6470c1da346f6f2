# SPDX-License-Identifier: Apache-2.0
"""The cost of accuracy in time: settings that differ in one thing, tried on one plant and compared."""
