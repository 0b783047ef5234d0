"""Binary glTF: one file of a JSON document and the numbers that it points at."""

from __future__ import annotations

import json
import os
import struct
from typing import Any

import numpy as np

from sacha_core.files import write_aside

__all__ = ["Glb"]

MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
COMPONENTS = {"|u1": 5121, "<u2": 5123, "<u4": 5125, "<f4": 5126}
KINDS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
ALIGNMENT = 4  # of everything in the file


class Glb:
    """A glTF file in the making.

    Attributes:
        document: the JSON document, to which everything is added that is no array.

    Source: Khronos Group, glTF 2.0 Specification, sections 3.6 and 4.
    """

    def __init__(self) -> None:
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "SACHA"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "bufferViews": [],
            "accessors": [],
        }
        self._binary = bytearray()

    def add(
        self, array: np.ndarray, *, bounds: bool = False, normalized: bool = False, target: int | None = None
    ) -> int:
        """Add an array as an accessor and give its index.

        Args:
            array: (n,), (n, 2), (n, 3), (n, 4) or (n, 4, 4) of unsigned integers or float32; matrices by rows, which glTF keeps by columns.
            bounds: tell the least and the largest of each component, which positions and times need.
            normalized: integers stand for 0 to 1.
            target: what a graphics card uses it for, `ARRAY_BUFFER` or `ELEMENT_ARRAY_BUFFER`; None for neither.
        """
        kind = KINDS[array.shape[1:]]
        little = np.ascontiguousarray(array.swapaxes(1, 2) if kind == "MAT4" else array, array.dtype.newbyteorder("<"))
        accessor: dict[str, Any] = {
            "bufferView": self.add_view(little.tobytes(), target),
            "componentType": COMPONENTS[little.dtype.str],
            "count": len(array),
            "type": kind,
        }
        if normalized:
            accessor["normalized"] = True
        if bounds:
            flat = little.reshape(len(little), -1)
            accessor |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        self.document["accessors"].append(accessor)
        return len(self.document["accessors"]) - 1

    def add_vertices(self, array: np.ndarray, *, bounds: bool = False, normalized: bool = False) -> int:
        """Add an attribute of vertices and give its index; see `add`."""
        return self.add(array, bounds=bounds, normalized=normalized, target=ARRAY_BUFFER)

    def add_indices(self, faces: np.ndarray) -> int:
        """Add the vertices of triangles, (f, 3), and give the index."""
        return self.add(faces.reshape(-1).astype(np.uint32), target=ELEMENT_ARRAY_BUFFER)

    def add_view(self, data: bytes, target: int | None = None) -> int:
        """Add bytes, such as those of an image, as a view of the buffer, and give its index."""
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        if target is not None:
            view["target"] = target
        self._binary += data + bytes(-len(data) % ALIGNMENT)
        self.document["bufferViews"].append(view)
        return len(self.document["bufferViews"]) - 1

    def to_bytes(self) -> bytes:
        """Give the whole file."""
        document = self.document | {"buffers": [{"byteLength": len(self._binary)}]}
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % ALIGNMENT)
        chunks = struct.pack("<I", len(text)) + JSON_CHUNK + text
        chunks += struct.pack("<I", len(self._binary)) + BINARY_CHUNK + self._binary
        return MAGIC + struct.pack("<II", VERSION, 12 + len(chunks)) + chunks

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the file.

        Raises:
            OSError: it cannot be written.
        """
        with write_aside(path) as aside:
            aside.write_bytes(self.to_bytes())
