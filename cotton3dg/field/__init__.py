# SPDX-License-Identifier: Apache-2.0
"""Many plants as an experiment: what the field book's columns mean, genotypes compared, tables for databases."""
