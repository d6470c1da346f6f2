# SPDX-License-Identifier: Apache-2.0
"""What is stated in Python, written as arguments of the command line and read again."""

from cotton3dg.choices import Asked
from cotton3dg.cli.arguments import parse_overrides
from cotton3dg.options import resolve


def test_values_from_python_are_arguments_that_a_run_reads_again():
    values = {"train": {"steps": 30}, "segment": {"method": "probability", "probability": {"threshold": 0.1 + 0.2}}}
    values |= {"scale": {"require_scale": True}, "traits": {"plant_id": "row = 3"}}
    words = Asked("draft", values=values).arguments
    assert words[-2:] == ["--preset", "draft"]
    read = parse_overrides([word for word in words[:-2] if word != "--set"])
    assert all(resolve(stage, asked=read[stage]) == resolve(stage, asked=own) for stage, own in values.items())
