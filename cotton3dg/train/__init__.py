# SPDX-License-Identifier: Apache-2.0
"""The training of the Gaussian model: its photos, its start, its steps, and how good the model became."""
