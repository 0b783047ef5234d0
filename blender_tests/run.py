"""Smoke test of the built add-on inside a Blender executable, as a user has one:

    blender --background --factory-startup --python blender_tests/run.py

needs no pytest. `SACHA_EXTENSION` names the zip, `SACHA_ENGINE` the Python that has the engine; Blender's own user folders are best
pointed elsewhere (`BLENDER_USER_RESOURCES`, and for old ones `BLENDER_USER_SCRIPTS`). Each check prints a line; the exit status is the
number of failures.
The oracle is what the engine's own functions say of the same avatar (`make_material.py`).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import traceback
import zipfile
from pathlib import Path

import addon_utils
import bpy
import numpy as np
from mathutils import Vector

HERE = Path(__file__).parent
sys.path.append(str(HERE))

from pictures import look_at, read, render, srgb  # noqa: E402  (these lie beside this file)
from traces import traces  # noqa: E402

ENGINE = os.environ.get("SACHA_ENGINE", str(HERE.parent / ".venv" / "bin" / "python"))
SIZE = 96  # pixels
NEAR = 0.02  # pixels: a centre this near to an edge may fall to either side
FILM_WIDTH, FILM_HEIGHT = 44, 64
SOFT_PIXELS = 60  # of some 700: Cycles' samples are spread over the pixel, so the outline's are anything between
MATERIAL_TIME_LIMIT_S = 120
FLOAT32_M = 1e-6  # rounding of a coordinate of some decimetres


def install() -> str:
    """Install the zip as this Blender's users do, as an extension or into the folder of add-ons; give the module's name."""
    extension = os.environ["SACHA_EXTENSION"]
    if hasattr(bpy.ops, "extensions") and "package_install_files" in dir(bpy.ops.extensions):
        bpy.ops.extensions.package_install_files(filepath=extension, repo="user_default", enable_on_install=True)
        return "bl_ext.user_default.sacha"
    folder = Path(bpy.utils.user_resource("SCRIPTS", path="addons", create=True)) / "sacha"
    with zipfile.ZipFile(extension) as archive:
        archive.extractall(folder)
    if str(folder.parent) not in sys.path:  # Blender looks there only if the folder was there when it started
        sys.path.append(str(folder.parent))
    raised: list[BaseException] = []
    addon_utils.enable("sacha", default_set=True, handle_error=raised.append)
    if raised:
        raise raised[0]
    return "sacha"


class Smoke:
    """The checks, in order; each goes on where the one before left Blender.

    Args:
        folder: where material and results go.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.before = folder, traces()
        command = [ENGINE, str(HERE / "make_material.py"), str(folder)]
        subprocess.run(command, check=True, timeout=MATERIAL_TIME_LIMIT_S, stdin=subprocess.DEVNULL)
        with np.load(folder / "truth.npz") as truth:
            self.truth = dict(truth)

    def check_1_registers(self) -> None:
        """Every class registers, and the preferences take the engine."""
        self.module = install()
        preferences = bpy.context.preferences.addons[self.module].preferences
        preferences.engine_python = ENGINE
        assert bpy.ops.sacha.check_engine() == {"FINISHED"}
        assert "SACHA" in preferences.found

    def check_2_imports(self) -> None:
        """A `.sacha` file becomes a mesh with the engine's vertices, triangles and numbers."""
        assert bpy.ops.sacha.open(filepath=str(self.folder / "avatar.sacha")) == {"FINISHED"}
        self.shown = next(one for one in bpy.data.objects if one.type == "MESH" and one.data.sacha.kind == "avatar")
        mesh = self.shown.data
        x, y, z = self.truth["vertices"].T
        found = read(mesh.vertices, "co", 3)
        assert np.abs(found - np.stack([x, -z, y], axis=1)).max() < FLOAT32_M
        assert np.array_equal(read(mesh.loops, "vertex_index", 1, np.int32).reshape(-1, 3), self.truth["faces"])
        for name, expected in (("region", self.truth["labels"]), ("count", self.truth["count"])):
            assert np.array_equal(read(mesh.attributes[name].data, "value", 1, np.int32).ravel(), expected), name

    def check_3_colours(self) -> None:
        """The region view's colours are those of the scheme, exactly."""
        mesh = self.shown.data
        mesh.sacha.view = "REGION"
        linear = read(mesh.color_attributes.active_color.data, "color", 4).reshape(-1, 3, 4)
        assert np.array_equal(srgb(linear[:, 0, :3]), self.truth["region_srgb"][self.truth["labels"]])
        assert (linear == linear[:, :1]).all()  # one colour a triangle

    def check_4_picture(self) -> None:
        """Every pixel of a picture has the colour of the triangle behind it."""
        camera = look_at(self.shown, SIZE)
        picture = render(self.folder / "picture.png")
        met = self.met(camera)
        sure = (met == met[0]).all(axis=0)
        on_head = sure & (met[0] >= 0)
        assert sure.mean() > 0.8
        assert on_head.mean() > 0.2
        assert (picture[sure & (met[0] < 0)] == 0).all()
        expected = self.truth["region_srgb"][self.truth["labels"][met[0][on_head]]]
        assert np.array_equal(picture[on_head][:, :3], expected)

    def check_5_encodes_and_decodes(self) -> None:
        """The avatar that is shown goes into a smaller file and comes back."""
        small, back = self.folder / "small.sacha", self.folder / "back.ply"
        bpy.context.scene.sacha.level = 1
        assert bpy.ops.sacha.encode(filepath=str(small)) == {"FINISHED"}
        assert 0 < small.stat().st_size < (self.folder / "avatar.sacha").stat().st_size
        assert bpy.ops.sacha.decode(source=str(small), filepath=str(back)) == {"FINISHED"}
        assert back.read_bytes().startswith(b"ply")

    def check_5_films(self) -> None:
        """A second Blender of this executable films the head where the engine's own geometry has it."""
        scene, setup = bpy.context.scene, bpy.context.scene.sacha_making
        bpy.context.view_layer.objects.active = self.shown
        bpy.ops.sacha.add_cameras(count=2)
        setup.renderer, setup.samples, setup.width, setup.height = "CYCLES", 4, FILM_WIDTH, FILM_HEIGHT
        scene.frame_end = scene.frame_start
        assert bpy.ops.sacha.film(directory=str(self.folder / "film")) == {"FINISHED"}
        told = self.folder / "film.json"
        command = [ENGINE, str(HERE / "film_truth.py"), setup.dataset, str(told)]
        subprocess.run(command, check=True, timeout=MATERIAL_TIME_LIMIT_S, stdin=subprocess.DEVNULL)
        for picture in json.loads(told.read_text())["pictures"]:
            assert picture["covered"] > 0.2 * FILM_WIDTH * FILM_HEIGHT, picture
            assert picture["wrong"] <= SOFT_PIXELS, picture

    def check_6_tells(self) -> None:
        """What goes wrong is said with what to do, and diagnostics hold it."""
        letter, diagnostics = self.folder / "letter.sacha", self.folder / "diagnostics.txt"
        letter.write_bytes(b"Dear Sir or Madam")
        try:
            bpy.ops.sacha.open(filepath=str(letter))
        except RuntimeError as error:
            assert "not a .sacha file" in str(error)  # noqa: PT017  (no pytest here)
            assert "get it again" in str(error)  # noqa: PT017
        else:
            raise AssertionError("a letter was opened as an avatar")
        bpy.ops.sacha.copy_diagnostics(filepath=str(diagnostics))
        assert bpy.app.version_string in diagnostics.read_text()

    def check_7_survives_save_and_reload(self) -> None:
        """A saved file brings everything back."""
        path = str(self.folder / "scene.blend")
        bpy.ops.wm.save_as_mainfile(filepath=path)
        bpy.ops.wm.open_mainfile(filepath=path)
        mesh = next(one for one in bpy.data.meshes if one.sacha.kind == "avatar")
        assert mesh.sacha.view == "REGION"
        assert np.array_equal(read(mesh.attributes["count"].data, "value", 1, np.int32).ravel(), self.truth["count"])

    def check_8_leaves_nothing(self) -> None:
        """Disabled, it is gone."""
        addon_utils.disable(self.module)
        left = {kind: now - self.before[kind] for kind, now in traces().items()}
        assert not any(left.values()), left

    def met(self, camera: bpy.types.Object) -> np.ndarray:
        """Give (5, h, w) triangles that rays through and just beside each pixel's centre meet; -1 for none."""
        corners = camera.data.view_frame(scene=bpy.context.scene)
        top_right, _, bottom_left, top_left = (camera.matrix_world @ Vector((x, y, 0)) for x, y, _ in corners)
        forward = -(camera.matrix_world.to_3x3() @ Vector((0, 0, 1)))
        right, up = (top_right - top_left) / SIZE, (top_left - bottom_left) / SIZE
        back = self.shown.matrix_world.inverted()
        found = np.empty((5, SIZE, SIZE), int)
        for place, (dx, dy) in enumerate([(0, 0), (NEAR, 0), (-NEAR, 0), (0, NEAR), (0, -NEAR)]):
            for row, column in np.ndindex(SIZE, SIZE):
                origin = bottom_left + right * (column + 0.5 + dx) + up * (row + 0.5 + dy)
                hit, _, _, face = self.shown.ray_cast(back @ origin, back.to_3x3() @ forward)
                found[place, row, column] = face if hit else -1
        return found


def main() -> int:
    """Run every check; give the number of those that failed."""
    results: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="sacha-smoke-") as folder:
        smoke = Smoke(Path(folder))
        for name in [name for name in dir(Smoke) if name.startswith("check_")]:
            try:
                getattr(smoke, name)()
                results[name] = "passed"
            except Exception:  # noqa: BLE001  (the next check may still tell something)
                results[name] = "failed"
                traceback.print_exc(file=sys.stdout)
                if not hasattr(smoke, "shown"):  # nothing is there to be checked
                    break
            finally:
                print(f"{results[name]}  {name[8:].replace('_', ' ')}", flush=True)  # noqa: T201
    failed = list(results.values()).count("failed")
    if "SACHA_SMOKE_REPORT" in os.environ:
        told = {"blender": bpy.app.version_string, "results": results}
        Path(os.environ["SACHA_SMOKE_REPORT"]).write_text(json.dumps(told), encoding="utf-8")
    print(f"Blender {bpy.app.version_string}: {len(results) - failed} passed, {failed} failed", flush=True)  # noqa: T201
    return failed


if __name__ == "__main__":
    sys.exit(main())
