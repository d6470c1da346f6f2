# SPDX-License-Identifier: Apache-2.0
"""The time that a run takes on this machine, and the settings that fit into a given time."""
