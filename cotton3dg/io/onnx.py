# SPDX-License-Identifier: Apache-2.0
"""ONNX files of feed-forward networks, written without the onnx package: the few message types that these need.

The format: https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..errors import BadInput

_TENSOR_KINDS: Final = {"float32": 1, "int64": 7, "float16": 10}
_FLOAT: Final = 1
_INT: Final = 2
_STRING: Final = 3
_INTS: Final = 7


def model(
    nodes: Sequence[bytes],
    constants: Mapping[str, NDArray[Any]],
    inputs: Mapping[str, Sequence[int | str]],
    outputs: Mapping[str, Sequence[int | str]],
    *,
    name: str = "network",
    opset: int = 13,
) -> bytes:
    """The bytes of an ONNX file.

    Args:
        nodes: from `node`, in order of execution.
        inputs, outputs: shapes of these tensors; a text stands for a side of any length.
    """
    graph = b"".join(field(1, item) for item in nodes) + field(2, name.encode())
    graph += b"".join(field(5, _tensor(key, values)) for key, values in constants.items())
    graph += b"".join(field(11, _value(key, shape)) for key, shape in inputs.items())
    graph += b"".join(field(12, _value(key, shape)) for key, shape in outputs.items())
    return field(1, 8) + field(7, graph) + field(8, field(1, b"") + field(2, opset))


def node(kind: str, inputs: Sequence[str], output: str, **attributes: int | float | str | Sequence[int]) -> bytes:
    """An operation that makes the tensor `output` and has the same name."""
    coded = b"".join(field(1, name.encode()) for name in inputs) + field(2, output.encode())
    coded += field(3, output.encode()) + field(4, kind.encode())
    return coded + b"".join(field(5, _attribute(name, content)) for name, content in attributes.items())


def field(number: int, content: int | bytes) -> bytes:
    """A protobuf field: a whole number, or bytes with their length."""
    if isinstance(content, int):
        return varint(number << 3) + varint(content)
    return varint(number << 3 | 2) + varint(len(content)) + content


def varint(number: int) -> bytes:
    """A whole number, seven bits per byte, lowest bits first."""
    coded = b""
    while True:
        number, low = number >> 7, number & 0x7F
        coded += bytes([low | (0x80 if number else 0)])
        if not number:
            return coded


def _attribute(name: str, content: int | float | str | Sequence[int]) -> bytes:
    head = field(1, name.encode())
    if isinstance(content, int):
        return head + field(3, content) + field(20, _INT)
    if isinstance(content, float):
        return head + varint(2 << 3 | 5) + np.float32(content).tobytes() + field(20, _FLOAT)
    if isinstance(content, str):
        return head + field(4, content.encode()) + field(20, _STRING)
    return head + b"".join(field(8, item) for item in content) + field(20, _INTS)


def _tensor(name: str, values: NDArray[Any]) -> bytes:
    dims = b"".join(field(1, side) for side in values.shape)
    return dims + field(2, _TENSOR_KINDS[values.dtype.name]) + field(8, name.encode()) + field(9, values.tobytes())


def _value(name: str, shape: Sequence[int | str]) -> bytes:
    sides = [field(1, side) if isinstance(side, int) else field(2, side.encode()) for side in shape]
    dims = b"".join(field(1, side) for side in sides)
    return field(1, name.encode()) + field(2, field(1, field(1, 1) + field(2, dims)))


def read_constants(model_bytes: bytes, name: str) -> dict[str, NDArray[Any]]:
    """The constants of a file that `model` wrote, by name.

    Raises:
        BadInput: `model` did not write the file.
    """
    try:
        constants = {}
        for number, content in _fields(_only(_fields(model_bytes), 7)):
            if number == 5 and isinstance(content, bytes):
                key, values = _read_tensor(content)
                constants[key] = values
        return constants
    except (ValueError, KeyError, IndexError, UnicodeDecodeError) as error:
        raise BadInput(f"{name} is not a network that cotton3dg wrote") from error


def _fields(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Number and content of each field of a protobuf message."""
    at = 0
    while at < len(message):
        key, at = _read_varint(message, at)
        kind = key & 7
        if kind == 0:
            content: int | bytes
            content, at = _read_varint(message, at)
        elif kind in {1, 2, 5}:
            size = {1: 8, 5: 4}.get(kind, 0)
            if kind == 2:
                size, at = _read_varint(message, at)
            content, at = message[at : at + size], at + size
            if at > len(message):
                raise ValueError("a field ends after its message")
        else:
            raise ValueError(f"fields of kind {kind} are not used")
        yield key >> 3, content


def _read_varint(message: bytes, at: int) -> tuple[int, int]:
    number = 0
    for shift in range(0, 70, 7):
        byte = message[at]
        number |= (byte & 0x7F) << shift
        at += 1
        if not byte & 0x80:
            return number, at
    raise ValueError("a number of more than ten bytes")


def _only(fields: Iterator[tuple[int, int | bytes]], wanted: int) -> bytes:
    for number, content in fields:
        if number == wanted and isinstance(content, bytes):
            return content
    raise KeyError(wanted)


def _read_tensor(message: bytes) -> tuple[str, NDArray[Any]]:
    shape, kind, name, raw = [], 0, "", b""
    for number, content in _fields(message):
        if isinstance(content, int):
            shape += [content] if number == 1 else []
            kind = content if number == 2 else kind
        elif number == 8:
            name = content.decode()
        elif number == 9:
            raw = content
    dtypes = {number: np.dtype(text) for text, number in _TENSOR_KINDS.items()}
    return name, np.frombuffer(raw, dtypes[kind]).reshape(shape)
