"""The network that comes with the program: gone, or not what it was."""

import pytest

from cotton3dg.errors import BadInput, MissingInput
from cotton3dg.masks import bolls


def test_shipped_weights_that_are_gone_or_damaged_name_the_remedy(tmp_path, monkeypatch):
    whole, checksum = bolls.SHIPPED_FILE.read_bytes(), bolls.SHIPPED_FILE.with_name("bolls.onnx.sha256").read_bytes()
    copy = tmp_path / bolls.SHIPPED_FILE.name
    copy.with_name("bolls.onnx.sha256").write_bytes(checksum)
    monkeypatch.setattr(bolls, "SHIPPED_FILE", copy)
    with pytest.raises(MissingInput, match="--backend lint"):
        bolls.shipped_weights()
    copy.write_bytes(whole[:1000])
    with pytest.raises(BadInput, match=r"damaged.*--backend lint"):
        bolls.shipped_weights()
    copy.write_bytes(whole)
    assert bolls.shipped_weights() == (whole, "bolls.onnx")
