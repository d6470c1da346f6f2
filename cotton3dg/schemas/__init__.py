# SPDX-License-Identifier: Apache-2.0
"""Files that stages leave to others: a frozen class for each, whose fields are its keys, with `load` beside `save`."""
