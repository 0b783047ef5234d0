"""GaussianAvatars' files: FLAME parameters as `.npz`, and the folder of a trained model."""

from __future__ import annotations

import os
import re
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import DYNAMIC_WIDTHS, Motion
from sacha_core.errors import FormatError
from sacha_core.files import write_aside
from sacha_core.flame.teeth import FLAME_VERTICES, N_TEETH_VERTICES
from sacha_core.interchange.splat_ply import read_bound_ply, write_bound_ply
from sacha_core.npz import as_float32, read_npz, write_npz

__all__ = [
    "fitted_offsets",
    "for_their_viewer",
    "model_iterations",
    "motion_from_arrays",
    "read_flame_param",
    "read_model",
    "write_flame_param",
    "write_model",
]

KEYS = {
    "expression": "expr",
    "rotation": "rotation",
    "neck": "neck_pose",
    "jaw": "jaw_pose",
    "eyes": "eyes_pose",
    "translation": "translation",
}
DYNAMIC_OFFSET = "dynamic_offset"  # allocated by GaussianAvatars and never used: not read, and written as zeros for it
FRAME_RATE = "frame_rate"  # ours, and ignored by others; left out where it is the usual one
USUAL_FRAME_RATE = 25.0
PLY_NAME, PARAMETERS_NAME, ARGUMENTS_NAME = "point_cloud.ply", "flame_param.npz", "cfg_args"
THEIR_VERTICES = FLAME_VERTICES + N_TEETH_VERTICES  # GaussianAvatars' head always has teeth
THEIR_SHAPE, THEIR_EXPRESSION = 300, 100
ARGUMENTS: dict[str, object] = {  # of GaussianAvatars' training, as its programs read them back
    "bind_to_mesh": True, "data_device": "cuda", "disable_flame_static_offset": False, "eval": True, "images": "images", "model_path": "",
    "not_finetune_flame_params": False, "resolution": -1, "select_camera_id": -1, "sh_degree": 3, "source_path": "", "target_path": "",
    "white_background": True,
}  # fmt: skip


def read_flame_param(path: str | os.PathLike[str]) -> Motion:
    """Read FLAME parameters: those of one timestep of a capture, or all of a trained model.

    Args:
        path: `flame_param/{timestep}.npz` or `flame_param.npz`; the arrays may be of any real type.

    Returns:
        The motion, float32; `static_offset` has no rows where the file has none.

    Raises:
        FormatError: the file is damaged, lacks a parameter, or has one of a wrong shape or not finite.
        OSError: the file cannot be read.
    """
    try:
        return motion_from_arrays(read_npz(path, skip=(DYNAMIC_OFFSET,)))
    except FormatError as error:
        raise error if str(path) in str(error) else FormatError(f"{path}: {error}") from error


def motion_from_arrays(arrays: dict[str, np.ndarray]) -> Motion:
    """Make a checked motion of arrays under GaussianAvatars' names.

    Raises:
        FormatError: an array is missing, of a wrong shape, or not finite.
    """
    missing = [key for key in ("shape", *KEYS.values()) if key not in arrays]
    if missing:
        raise FormatError(f"FLAME parameters lack {', '.join(missing)}")
    values = {key: _real(key, arrays[key]) for key in ("shape", *KEYS.values())}
    offset = _real("static_offset", arrays.get("static_offset", np.zeros((0, 3), np.float32)))
    offset = offset[0] if offset.ndim == 3 and len(offset) == 1 else offset
    if offset.ndim != 2 or offset.shape[1] != 3:
        raise FormatError(f"static_offset has shape {offset.shape}, expected (1, vertices, 3)")
    for name, key in KEYS.items():
        width = DYNAMIC_WIDTHS.get(name)
        if values[key].ndim != 2 or (width is not None and values[key].shape[1] != width):
            raise FormatError(f"{key} has shape {values[key].shape}, expected (frames, {width or 'components'})")
    rate = arrays.get(FRAME_RATE, np.array(USUAL_FRAME_RATE))
    if rate.size != 1 or rate.dtype.kind not in "fiu":
        raise FormatError(f"{FRAME_RATE} has shape {rate.shape} of {rate.dtype}, expected one real number")
    shape = values["shape"][0] if values["shape"].ndim == 2 and len(values["shape"]) == 1 else values["shape"]
    if shape.ndim != 1:
        raise FormatError(f"shape has shape {shape.shape}, expected (components,)")
    dynamic = {name: values[key] for name, key in KEYS.items()}
    motion = Motion(shape=shape, static_offset=offset, **dynamic, frame_rate=float(rate.reshape(())))
    motion.validate()
    return motion


def write_flame_param(path: str | os.PathLike[str], motion: Motion, *, dynamic_offset: bool = False) -> None:
    """Write FLAME parameters as GaussianAvatars does.

    Args:
        path: the `.npz` file.
        motion: one frame for a timestep of a capture, all frames for a trained model.
        dynamic_offset: add the zeros that GaussianAvatars expects in a trained model.

    Raises:
        OSError: the file cannot be written.
    """
    arrays = {"shape": motion.shape} | {key: getattr(motion, name) for name, key in KEYS.items()}
    arrays["static_offset"] = motion.static_offset[None]
    if dynamic_offset:
        arrays[DYNAMIC_OFFSET] = np.zeros((len(motion), *motion.static_offset.shape))
    arrays = {key: np.ascontiguousarray(array, np.float32) for key, array in arrays.items()}
    if motion.frame_rate != USUAL_FRAME_RATE:
        arrays[FRAME_RATE] = np.array(motion.frame_rate)
    write_npz(path, arrays, compress=dynamic_offset)


def fitted_offsets(motion: Motion, n_vertices: int) -> Motion:
    """Give a motion whose personal offsets fit FLAME's head with GaussianAvatars' teeth or without, whichever has so many vertices.

    The teeth are the last vertices. Offsets that lack them are given zeros, as GaussianAvatars does; offsets that have them lose them.
    """
    offset = motion.static_offset
    if {len(offset), n_vertices} != {FLAME_VERTICES, THEIR_VERTICES}:
        return motion
    fitted = np.zeros((n_vertices, 3), offset.dtype)
    fitted[:FLAME_VERTICES] = offset[:FLAME_VERTICES]
    return replace(motion, static_offset=fitted)


def for_their_viewer(motion: Motion) -> Motion:
    """Give a motion of FLAME with as many numbers as GaussianAvatars' programs insist on; those added are zeros."""
    offset = motion.static_offset if len(motion.static_offset) else np.zeros((FLAME_VERTICES, 3), np.float32)
    shape = np.pad(motion.shape, (0, max(THEIR_SHAPE - len(motion.shape), 0)))
    expression = np.pad(motion.expression, ((0, 0), (0, max(THEIR_EXPRESSION - motion.expression.shape[1], 0))))
    wide = replace(motion, shape=shape, static_offset=offset, expression=expression)
    return fitted_offsets(wide, THEIR_VERTICES)


def model_iterations(folder: str | os.PathLike[str]) -> dict[int, Path]:
    """List the iterations of a trained model that hold Gaussians, ascending, with their folders."""
    found = {}
    for ply in Path(folder).glob(f"point_cloud/iteration_*/{PLY_NAME}"):
        number = re.fullmatch(r"iteration_(\d{1,9})", ply.parent.name)
        if number:
            found[int(number[1])] = ply.parent
    return dict(sorted(found.items()))


def read_model(
    folder: str | os.PathLike[str], iteration: int | None = None, n_faces: int | None = None
) -> tuple[Gaussians, Motion | None]:
    """Read a trained model.

    Args:
        folder: of the model, or one of its `iteration_*` folders.
        iteration: which; by default the last.
        n_faces: triangles of the head, where known: bindings are checked against it.

    Returns:
        Its Gaussians, and the motion that it was trained on where that lies beside them.

    Raises:
        FormatError: there is no such iteration, or a file of it is damaged.
        OSError: a file cannot be read.
    """
    place = Path(folder)
    if iteration is not None or not (place / PLY_NAME).is_file():
        iterations = model_iterations(place)
        chosen = max(iterations, default=0) if iteration is None else iteration
        if chosen not in iterations:
            held = ", ".join(map(str, iterations)) or "none"
            wanted = "" if iteration is None else f" {iteration}"
            raise FormatError(
                f"{folder} holds no iteration{wanted} (point_cloud/iteration_*/{PLY_NAME}); there are: {held}"
            )
        place = iterations[chosen]
    parameters = place / PARAMETERS_NAME
    motion = read_flame_param(parameters) if parameters.is_file() else None
    return read_bound_ply(place / PLY_NAME, n_faces), motion


def write_model(
    folder: str | os.PathLike[str], iteration: int, gaussians: Gaussians, motion: Motion | None = None
) -> Path:
    """Write a trained model as GaussianAvatars lays it out, and give the folder of the iteration.

    The arguments of a training are written where there are none: `render.py` of GaussianAvatars wants them.

    Raises:
        OSError: a file cannot be written.
    """
    arguments = Path(folder) / ARGUMENTS_NAME
    if not arguments.exists():
        with write_aside(arguments) as aside:
            aside.write_text(repr(Namespace(**ARGUMENTS)), encoding="utf-8")
    place = Path(folder) / "point_cloud" / f"iteration_{iteration}"
    if motion is not None:
        write_flame_param(place / PARAMETERS_NAME, motion, dynamic_offset=True)
    write_bound_ply(place / PLY_NAME, gaussians)  # last: an iteration counts as there when its Gaussians are
    return place


def _real(key: str, array: np.ndarray) -> np.ndarray:
    if not (np.issubdtype(array.dtype, np.floating) or np.issubdtype(array.dtype, np.integer)):
        raise FormatError(f"{key} is of {array.dtype}, expected real numbers")
    return as_float32(array)
