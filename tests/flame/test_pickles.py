"""Oracle: the arrays that a fabricated pickle of FLAME's structure was made of. Nothing a pickle says may ever run."""

from __future__ import annotations

import contextlib
import pickle
import pickletools
import struct
import sys
import tracemalloc
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from sacha_core.errors import FormatError, HeadError, SachaError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.pickles import read_flame_pickle, read_masks
from sacha_core.flame.unpickler import read_pickle

V, F, N_IDENTITY = 30, 40, 6


@pytest.fixture
def chumpy() -> Iterator[types.SimpleNamespace]:
    """Stand-ins under chumpy's names, only while pickles are written."""
    made = {}
    for module, name in (("chumpy.ch", "Ch"), ("chumpy.reordering", "Select"), ("chumpy.reordering", "Reshape")):
        kind = type(name, (), {"__module__": module})
        sys.modules.setdefault(module, types.ModuleType(module)).__dict__[name] = kind
        made[name] = kind
    sys.modules["chumpy"] = types.ModuleType("chumpy")
    yield types.SimpleNamespace(**made)
    for module in ("chumpy", "chumpy.ch", "chumpy.reordering"):
        del sys.modules[module]


def with_state(kind: type, **state: object) -> Any:
    made = kind()
    made.__dict__.update(state)
    return made


def content(head: HeadModel, **changes: object) -> dict[str, object]:
    kintree = np.array([[2**32 - 1, 0, 1, 1, 1], np.arange(5)], np.int64)
    made: dict[str, object] = {
        "v_template": head.v_template.astype(np.float64),
        "f": head.faces.astype(np.uint32),
        "shapedirs": np.concatenate([head.shapedirs, head.exprdirs], axis=2).astype(np.float64),
        "posedirs": head.posedirs.astype(np.float64),
        "J_regressor": csc_matrix(head.J_regressor.astype(np.float64)),
        "kintree_table": kintree,
        "weights": np.asfortranarray(head.weights.astype(np.float64)),
        "bs_style": "lbs",
        "bs_type": "lrotmin",
        "J": None,
    }
    return made | changes


def save(path: Path, value: object, protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(value, protocol))
    return path


def assert_same(made: HeadModel, head: HeadModel) -> None:
    for name in ("v_template", "faces", "shapedirs", "exprdirs", "posedirs", "J_regressor", "weights", "parents"):
        one, other = getattr(made, name), getattr(head, name)
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_plain_arrays_of_every_protocol(random_head: HeadModel, tmp_path: Path, protocol: int) -> None:
    path = save(tmp_path / "flame.pkl", content(random_head), protocol)
    assert_same(read_flame_pickle(path, N_IDENTITY), random_head)


def test_chumpy_arrays_and_choices(random_head: HeadModel, tmp_path: Path, chumpy: types.SimpleNamespace) -> None:
    shape = np.concatenate([random_head.shapedirs, random_head.exprdirs], axis=2).astype(np.float64)
    stored = np.random.default_rng(0).permutation(random_head.v_template.size)
    scattered = np.empty(random_head.v_template.size)
    scattered[stored] = random_head.v_template.ravel()
    changes = {
        "shapedirs": with_state(chumpy.Ch, x=shape, dirty=True),
        "v_template": with_state(
            chumpy.Select, a=with_state(chumpy.Ch, x=scattered.reshape(3, -1)), idxs=stored, preferred_shape=(V, 3)
        ),
    }
    path = save(tmp_path / "flame.pkl", content(random_head, **changes))
    assert_same(read_flame_pickle(path, N_IDENTITY), random_head)


def test_other_operations_of_chumpy_are_named(
    random_head: HeadModel, tmp_path: Path, chumpy: types.SimpleNamespace
) -> None:
    path = save(tmp_path / "flame.pkl", content(random_head, weights=with_state(chumpy.Reshape, a=1)))
    with pytest.raises(FormatError, match=r"flame\.pkl: the pickle asks for chumpy\.reordering\.Reshape"):
        read_flame_pickle(path, N_IDENTITY)


def test_big_endian_and_other_number_types(random_head: HeadModel, tmp_path: Path) -> None:
    changes = {
        "v_template": random_head.v_template.astype(">f4"),
        "weights": random_head.weights.astype(">f8"),
        "f": random_head.faces.astype("<i2"),
    }
    assert_same(read_flame_pickle(save(tmp_path / "a.pkl", content(random_head, **changes)), N_IDENTITY), random_head)


@pytest.mark.wrong_shapes
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"f": None}, "f is a NoneType, expected an array of numbers"),
        ({"f": np.full((F, 3), V)}, "faces of head 'a' has index 30"),
        ({"f": np.zeros((F, 3))}, "f has shape .* of float64, expected .* vertex indices"),
        ({"weights": np.ones((V, 5))}, "skinning weights of vertex 0"),
        ({"weights": np.array([["x"]])}, "an array is of dtype 'U1'"),
        ({"weights": np.array([[None]])}, "an array"),
        ({"shapedirs": np.zeros((V, 3, 2))}, "shapedirs has 2 directions, expected 6 of identity"),
        ({"shapedirs": np.zeros(7)}, "shapedirs has shape"),
        ({"v_template": np.full((V, 3), np.nan)}, "v_template of head 'a' is not finite"),
        ({"kintree_table": np.zeros(4)}, "kintree_table has shape"),
        (
            {"kintree_table": np.full((2, 5), np.nan)},
            "kintree_table has shape .* of float64, expected .* joint indices",
        ),
        ({"v_template": np.zeros(5)}, "v_template has shape"),
        ({"kintree_table": np.array([[0, 3, 0, 0, 0]] * 2)}, "parents of head 'a' are"),
        ({"J_regressor": csc_matrix(np.ones((5, V + 1)))}, "J_regressor of head 'a' has shape"),
        ({"J_regressor": np.ones((4, V))}, "J_regressor of head 'a' has shape"),
    ],
)
def test_arrays_that_do_not_fit_are_named(
    random_head: HeadModel, tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    path = save(tmp_path / "a.pkl", content(random_head, **changes))
    with pytest.raises((FormatError, HeadError), match=rf"a\.pkl: {message}"):
        read_flame_pickle(path, N_IDENTITY)


class Record:
    """Pickles as `make(*arguments)`, followed by any state."""

    def __init__(self, make: object, arguments: tuple[object, ...], state: object) -> None:
        self.recipe = make, arguments, state

    def __reduce__(self) -> Any:
        return self.recipe


def array_of(state: object) -> Record:
    return Record(np.array(0).__reduce__()[0], (np.ndarray, (0,), b"b"), state)


def dtype_of(code: str, order: object) -> Record:
    return Record(np.dtype, (code, False, True), (3, order, None, None, None, -1, -1, 0))


@pytest.mark.parametrize(
    "state",
    [
        3,
        "x",
        (),
        (1, (1,), None, False, bytes(8)),
        (1, (1,), dtype_of("f9", "<"), False, bytes(8)),
        (1, (1,), dtype_of("u", "<"), False, bytes(8)),
        (1, (1,), dtype_of("f8", [1]), False, bytes(8)),
        (1, (1,), np.dtype("f8"), False, "\u1234" * 8),
        (1, (1,), np.dtype("f8"), False, bytes(7)),
        (1, (-1,), np.dtype("f8"), False, bytes(8)),
        (1, (True,), np.dtype("f8"), False, bytes(8)),
        (1, (1.0,), np.dtype("f8"), False, bytes(8)),
        (1, 1, np.dtype("f8"), False, bytes(8)),
        (1, (1,) * 70, np.dtype("f8"), False, bytes(8)),
        (1, (0, 2**62, 2**62), np.dtype("f8"), False, b""),
        (1, (0, 2**30, 2**30, 2**30), np.dtype("f8"), True, b""),
    ],
)
def test_arrays_that_are_none(random_head: HeadModel, tmp_path: Path, state: object) -> None:
    path = save(tmp_path / "a.pkl", content(random_head, v_template=array_of(state)))
    with pytest.raises(FormatError, match=r"a\.pkl: (an array|v_template)"):
        read_flame_pickle(path, N_IDENTITY)
    with pytest.raises(FormatError, match=r"a\.pkl: (an array|mask)"):
        read_masks(save(tmp_path / "a.pkl", {"lips": array_of(state)}))


DEEP = b")" + b"\x85" * 300_000  # hashing or printing what is nested so deep overruns the stack


@pytest.mark.parametrize(
    "program",
    [
        b"\x80\x02}" + DEEP + b"K\x01s.",
        b"\x80\x02}(" + DEEP + b"K\x01u.",
        b"\x80\x02(" + DEEP + b"K\x01d.",
        b"\x80\x04\x8f(" + DEEP + b"\x90.",
        b"\x80\x04(" + DEEP + b"\x91.",
        b"\x80\x02}U\x04lips" + DEEP + b"s.",
        b"\x80\x02}U\x04lipscnumpy\nndarray\n)R(K\x01" + DEEP + b"cnumpy\ndtype\nU\x02f4\x85RK\x00U\x00tbs.",
        b"\x80\x02}K\x05K\x05s.",
        b"\x80\x02]U\x01xK\x05s.",
    ],
)
def test_what_is_nested_too_deep_is_left_alone(tmp_path: Path, program: bytes) -> None:
    (tmp_path / "a.pkl").write_bytes(program)
    with pytest.raises(FormatError, match=r"a\.pkl"):
        read_masks(tmp_path / "a.pkl")


@pytest.mark.parametrize(
    "program",
    [
        b"\x80\x05\x96" + struct.pack("<Q", 1 << 28) + b".",
        b"\x80\x02]q\x00c_codecs\nencode\nq\x01X\x00\x00\x10\x00" + b"a" * (1 << 20) + b"U\x06latin1\x86q\x020"
        + b"h\x00h\x01h\x02Ra0" * 300 + b"h\x00.",
    ],
    ids=["bytes that are only claimed", "the same bytes over and over"],
)  # fmt: skip
def test_memory_grows_with_the_file_only(tmp_path: Path, program: bytes) -> None:
    (tmp_path / "a.pkl").write_bytes(program)
    tracemalloc.start()
    with contextlib.suppress(FormatError):
        read_pickle(tmp_path / "a.pkl")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10 * len(program) + (1 << 20)


def broken_sparse(**state: object) -> csc_matrix:
    matrix = csc_matrix(np.ones((5, V)))
    matrix.__dict__.update(state)
    return matrix


@pytest.mark.parametrize(
    "state",
    [
        {"_shape": (5, 10**9)},
        {"_shape": (-5, V)},
        {"_shape": "x"},
        {"indptr": np.arange(V + 1) * 6},
        {"indptr": np.arange(V)},
        {"indptr": np.arange(V + 1)[::-1].copy() * 5},
        {"indices": np.full(5 * V, 5)},
        {"indices": np.full(5 * V, -1)},
        {"indices": np.zeros(3)},
        {"data": np.ones(3)},
        {"data": None},
    ],
)
def test_sparse_matrices_that_are_none(random_head: HeadModel, tmp_path: Path, state: dict[str, object]) -> None:
    path = save(tmp_path / "a.pkl", content(random_head, J_regressor=broken_sparse(**state)))
    with pytest.raises(FormatError, match="J_regressor"):
        read_flame_pickle(path, N_IDENTITY)


def test_missing_keys_are_all_named(random_head: HeadModel, tmp_path: Path) -> None:
    made = content(random_head)
    del made["weights"], made["f"]
    with pytest.raises(FormatError, match="lacks f, weights, which a FLAME model has"):
        read_flame_pickle(save(tmp_path / "a.pkl", made), N_IDENTITY)
    with pytest.raises(FormatError, match="holds a list, expected the dictionary"):
        read_flame_pickle(save(tmp_path / "a.pkl", [1, 2]))


class Runs:
    """Calls whatever it is told to when unpickled."""

    def __init__(self, function: object, *arguments: object) -> None:
        self.call = function, arguments

    def __reduce__(self) -> Any:
        return self.call


@pytest.mark.parametrize("protocol", [0, 2, 4, 5])
@pytest.mark.parametrize(
    ("function", "name"),
    [
        (Path.touch, "PosixPath|getattr|Path"),
        (exec, "exec"),
        (eval, "eval"),
        (getattr, "getattr"),
        (__import__, "__import__"),
        (np.load, "load"),
        (pickle.loads, "loads"),
    ],
)
def test_code_is_named_and_never_run(tmp_path: Path, function: Any, name: str, protocol: int) -> None:
    victim = tmp_path / "victim"
    argument = victim if function is Path.touch else f"open({str(victim)!r}, 'w')"
    path = save(tmp_path / "a.pkl", {"v_template": Runs(function, argument)}, protocol)
    with pytest.raises(FormatError, match=rf"asks for .*({name}).* nothing was run"):
        read_flame_pickle(path)
    assert not victim.exists()


@pytest.mark.parametrize(
    "program",
    [
        b"cos\nsystem\n(S'touch victim'\ntR.",
        b"(S'touch victim'\nios\nsystem\n.",
        b"(cos\nsystem\nS'touch victim'\no.",
        b"\x80\x02cnumpy\ndtype\n(S'f4'\ntRS'__class__'\nR.",
        b"\x80\x02cnumpy\ndtype\n}S'x'\nK\x01sb.",
        b"\x80\x02c_codecs\nencode\n}S'__code__'\nK\x01sb.",
        b"\x80\x02cnumpy\nndarray\n(K\x01tR(K\x01K\x02tb.",
        b"\x80\x02c_codecs\nencode\n)\x81.",
        b"\x80\x04\x8c\x0bnumpy.linalg\x8c\x03inv\x93.",
        b"\x80\x04\x8c\x05numpy\x8c\x12ndarray.__reduce__\x93.",
        b"Pid\n.",
        b"\x80\x02\x82\x01.",
        b"\x80\x02J\x01\x00\x00\x00R.",
        b".",
        b"",
        b"\x80\xff.",
        b"(" * 100_000,
        b"\x80\x04\x95" + struct.pack("<Q", 2**62) + b".",
        b"\x80\x04\x8e" + struct.pack("<Q", 2**62) + b".",
        b"\x80\x02r\xff\xff\xff\x7f.",
        b"\x80\x02]r\xff\xff\xff\x7fe.",
        b"\x80\x028" + b"9" * 100 + b".",
        b"I" + b"9" * 5000 + b"\n.",
    ],
)
def test_hostile_programs(tmp_path: Path, program: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.pkl").write_bytes(program)
    with pytest.raises(FormatError, match=r"a\.pkl"):
        read_flame_pickle("a.pkl")
    assert not Path("victim").exists()


def test_cut_and_changed_pickles(random_head: HeadModel, tmp_path: Path) -> None:
    whole = pickle.dumps(content(random_head), 2)
    skeleton = [
        at for op, argument, at in pickletools.genops(whole) if not isinstance(argument, str) or len(argument) < 50
    ]
    rng = np.random.default_rng(0)
    path = tmp_path / "a.pkl"
    for trial in range(300):
        data = bytearray(whole[: rng.integers(len(whole))] if trial % 4 == 0 else whole)
        for _ in range(1 + trial % 3):
            at = int(rng.choice(skeleton)) + int(rng.integers(3))
            if at < len(data):
                data[at] = rng.integers(256)
        path.write_bytes(data)
        with contextlib.suppress(SachaError):  # anything else escapes and fails the test
            read_flame_pickle(path, N_IDENTITY).validate()


def test_reading_leaves_no_trace_in_the_reader(random_head: HeadModel, tmp_path: Path) -> None:
    one, other = (read_pickle(save(tmp_path / "a.pkl", content(random_head))) for _ in range(2))
    assert isinstance(one, dict)
    assert isinstance(other, dict)
    assert one["weights"] is not other["weights"]


@pytest.mark.parametrize("kind", ["pkl", "npz"])
def test_masks(tmp_path: Path, kind: str) -> None:
    masks = {"lips": np.array([5, 3, 3, 9]), "nose": np.zeros(0, np.int32), "face": np.arange(4.0)}
    path = tmp_path / f"masks.{kind}"
    if kind == "pkl":
        save(path, masks)
    else:
        np.savez(path, **masks)
    read = read_masks(path)
    assert {name: mask.tolist() for name, mask in read.items()} == {"lips": [3, 5, 9], "nose": [], "face": [0, 1, 2, 3]}
    assert {mask.dtype for mask in read.values()} == {np.dtype(np.int32)}


@pytest.mark.parametrize(
    "mask",
    [np.array([-1]), np.array([0.5]), np.array([[1]]), np.array([2**40]), np.array([np.nan]), np.array(["a"]), 7],
)
def test_masks_that_are_none(tmp_path: Path, mask: object) -> None:
    with pytest.raises(FormatError, match=r"a\.pkl|an array is of dtype"):
        read_masks(save(tmp_path / "a.pkl", {"lips": mask}))
    with pytest.raises(FormatError, match="holds no vertex masks"):
        read_masks(save(tmp_path / "a.pkl", {}))


@pytest.mark.real_data
def test_flames_own_masks(real_data: Path) -> None:
    masks = read_masks(real_data / "FLAME_masks.npz")
    assert len(masks) == 14
    assert len(masks["lips"]) == 250
    assert len(masks["face"]) == 1787
