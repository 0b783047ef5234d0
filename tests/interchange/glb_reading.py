"""A reader of binary glTF for tests, from the specification alone, and the Khronos Group's validator."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
KINDS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
VARIABLE, REQUIRE = "SACHA_GLTF_VALIDATOR", "SACHA_REQUIRE_PEERS"
PACKAGE = Path(__file__).parents[2] / ".peers" / "node_modules" / "gltf-validator"
PROGRAM = """
const validator = require(process.argv[1]);
const bytes = new Uint8Array(require("fs").readFileSync(process.argv[2]));
validator.validateBytes(bytes, {maxIssues: 0}).then((report) => console.log(JSON.stringify(report)));
"""


class Glb:
    """A file that was read."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        n_json, kind = struct.unpack_from("<I4s", data, 12)
        assert kind == b"JSON"
        self.document: dict[str, Any] = json.loads(data[20 : 20 + n_json])
        n_binary, kind = struct.unpack_from("<I4s", data, 20 + n_json)
        assert kind == b"BIN\0"
        assert n_json % 4 == n_binary % 4 == 0
        self.binary = data[28 + n_json :]
        assert len(self.binary) == n_binary

    def array(self, index: int) -> np.ndarray:
        accessor = self.document["accessors"][index]
        view = self.document["bufferViews"][accessor["bufferView"]]
        width = WIDTHS[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        flat = np.frombuffer(self.binary, KINDS[accessor["componentType"]], accessor["count"] * width, start)
        assert flat.nbytes <= view["byteLength"]
        return flat if width == 1 else flat.reshape(-1, width)

    def view(self, index: int) -> bytes:
        view = self.document["bufferViews"][index]
        return self.binary[view["byteOffset"] :][: view["byteLength"]]


def validated(path: Path) -> list[dict[str, Any]]:
    """Give what the validator has to say, or skip; SACHA_REQUIRE_PEERS=gltf or `all` forbids skipping."""
    package = Path(os.environ.get(VARIABLE, PACKAGE))
    if not package.is_dir() or shutil.which("node") is None:
        if {"gltf", "all"} & set(os.environ.get(REQUIRE, "").split(",")):
            pytest.fail(f"{REQUIRE} is set, and there is no validator at {package}, or no node to run it")
        pytest.skip("needs the Khronos Group's gltf-validator: `make peers`")
    done = subprocess.run(
        ["node", "-e", PROGRAM, str(package.resolve()), str(path)], capture_output=True, check=True, timeout=120
    )
    messages: list[dict[str, Any]] = json.loads(done.stdout)["issues"]["messages"]
    return messages
