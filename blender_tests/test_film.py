"""Filming a head: the dataset is what the scene shows, from where its cameras stand, with the parameters that its controls are set to."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import bpy
import numpy as np
import pytest
from conftest import ENGINE, Material
from mathutils import Euler, Vector

TRUTH_LIMIT_S, FILM_LIMIT_S = 60, 120
WIDTH, HEIGHT = 44, 64
WRONG_PIXELS = 6  # of some 700 covered: those whose centre lies on the outline, up to single precision
SOFT_PIXELS = 60  # Cycles' samples are spread over the pixel, so the outline's are anything between
SCULPTED_M = 3e-4  # less than joints, which were placed before, put off by half a millimetre
CONTROL_TOLERANCE = 2e-5  # single precision, through matrices and back


@pytest.fixture
def studio(opened: bpy.types.Object, tmp_path: Path) -> bpy.types.Object:
    """The material's avatar, moved, turned and with a jaw opened by hand, between three cameras; small pictures without smoothing."""
    scene, setup = bpy.context.scene, bpy.context.scene.sacha_making
    scene.frame_start, scene.frame_end = 1, 3
    setup.renderer, setup.width, setup.height = "BLENDER_WORKBENCH", WIDTH, HEIGHT
    scene.display.render_aa = "OFF"
    setup.film_folder = str(tmp_path / "film")
    armature = opened.parent
    armature.location, armature.rotation_mode = (0.3, -0.2, 1.5), "XYZ"
    armature.rotation_euler = Euler((0.1, -0.2, 0.4))
    bpy.context.view_layer.update()
    bpy.ops.sacha.add_cameras(count=3, arc_deg=80.0, distance=0.9)
    return opened


def truth(dataset: Path, tmp_path: Path) -> dict:
    """Let the engine read a dataset, and say how it compares with its own geometry."""
    out = tmp_path / "truth.json"
    script = Path(__file__).with_name("film_truth.py")
    subprocess.run([ENGINE, script, dataset, out], check=True, timeout=TRUTH_LIMIT_S, stdin=subprocess.DEVNULL)
    return json.loads(out.read_text())


def test_a_filmed_head_is_where_the_dataset_says_and_becomes_an_avatar(
    studio: bpy.types.Object, addon: ModuleType, material: Material, tmp_path: Path
) -> None:
    assert bpy.ops.sacha.film() == {"FINISHED"}
    dataset = Path(bpy.context.scene.sacha_making.dataset)
    assert dataset.parent == tmp_path / "film"
    found = truth(dataset, tmp_path)
    pictures = found["pictures"]
    assert len(pictures) == 9
    assert {picture["split"] for picture in pictures if picture["timestep"] == 0} == {"train", "val"}
    for picture in pictures:
        assert picture["covered"] > 0.2 * WIDTH * HEIGHT
        assert picture["wrong"] <= WRONG_PIXELS, picture
        assert picture["white_outside"]
    assert found["n_offsets"] == 0
    assert np.allclose(found["expression"], material.truth["expression"], atol=CONTROL_TOLERANCE)
    assert np.allclose(found["shape"], material.truth["shape"], atol=CONTROL_TOLERANCE)
    assert found["frame_rate"] == bpy.context.scene.render.fps / bpy.context.scene.render.fps_base
    assert not (tmp_path / "film" / "footage").exists()  # what it was made of is cleared away
    known_runs = __import__(f"{addon.__name__}.making.known_runs", fromlist=["forget"])
    bpy.ops.sacha.train(model=str(tmp_path / "model"), iterations=12)  # of what was filmed last
    known_runs.forget(tmp_path / "model")
    told = json.loads((tmp_path / "model" / "run" / "report.json").read_text())
    bpy.ops.sacha.open(filepath=str(tmp_path / "model"))
    assert any(f"{told['n_gaussians']:,} Gaussians" in fact.name for fact in bpy.context.object.data.sacha.facts)


def test_cycles_films_what_is_chosen_and_a_sculpted_person_has_offsets(
    studio: bpy.types.Object, tmp_path: Path
) -> None:
    scene, setup = bpy.context.scene, bpy.context.scene.sacha_making
    bpy.ops.mesh.primitive_plane_add(size=50.0, location=(0.0, 3.0, 0.0), rotation=(math.pi / 2, 0.0, 0.0))
    bpy.context.object.select_set(False)
    bpy.context.view_layer.objects.active = studio
    key = studio.data.shape_keys.reference_key
    points = np.empty(3 * len(key.data), np.float32)
    key.data.foreach_get("co", points)
    key.data[int(np.argmin(points[1::3]))].co.y -= SCULPTED_M  # the nose, which is foremost
    setup.renderer, setup.samples, setup.only_selected, scene.frame_end = "CYCLES", 4, True, 1
    bpy.ops.sacha.film(take="CYCLES")
    found = truth(Path(setup.dataset), tmp_path)
    assert found["n_offsets"] == len(key.data)
    for picture in found["pictures"]:
        assert picture["wrong"] <= SOFT_PIXELS, picture


def test_a_head_that_something_else_moves_is_refused_before_any_picture(
    studio: bpy.types.Object, tmp_path: Path
) -> None:
    own = studio.shape_key_add(name="my own", from_mix=False)  # no parameter says what an artist's own key does
    own.data[7].co.x += 0.01
    own.value = 1.0
    with pytest.raises(
        RuntimeError, match=r"the head at timestep 0 is not where its parameters put it: vertex 7 is \d+\.\d\d mm"
    ):
        bpy.ops.sacha.film()
    assert not list((tmp_path / "film").rglob("*.png"))


def test_pictures_of_an_interrupted_filming_can_be_kept(studio: bpy.types.Object, tmp_path: Path) -> None:
    """What lies there is taken as it is: a picture that was painted over shows up in the dataset."""
    bpy.context.scene.frame_end = 1
    footage = tmp_path / "film" / "footage"
    footage.mkdir(parents=True)
    image = bpy.data.images.new("painted", WIDTH, HEIGHT, alpha=True)
    image.pixels.foreach_set(np.tile(np.array([1, 0, 0, 1], np.float32), WIDTH * HEIGHT))
    image.filepath_raw, image.file_format = str(footage / "00000_00.png"), "PNG"
    image.save()
    bpy.ops.sacha.film(resume=True)
    pictures = truth(Path(bpy.context.scene.sacha_making.dataset), tmp_path)["pictures"]
    wrong = {picture["camera"]: picture["wrong"] > WRONG_PIXELS for picture in pictures}
    assert wrong == {0: True, 1: False, 2: False}


def test_a_cancelled_filming_ends_its_blender_and_keeps_its_pictures(
    studio: bpy.types.Object, addon: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = __import__(f"{addon.__name__}.running", fromlist=["now"])
    monkeypatch.setattr(running, "events_come", lambda: True)
    setup = bpy.context.scene.sacha_making
    setup.renderer, setup.samples, setup.width, setup.height = "CYCLES", 250, 150, 200  # time enough to be cancelled
    assert bpy.ops.sacha.film("EXEC_DEFAULT", wait=False) == {"RUNNING_MODAL"}
    operator, job = bpy.context.window.modal_operators[0], running.now().job
    end = time.monotonic() + FILM_LIMIT_S

    def tick_while(condition: Callable[[], bool]) -> set[str]:
        while condition():
            assert time.monotonic() < end, "waited in vain"
            time.sleep(0.05)
            answer = type(operator).modal(operator, bpy.context, SimpleNamespace(type="TIMER"))
            if answer != {"PASS_THROUGH"}:
                return answer
        return {"PASS_THROUGH"}

    assert tick_while(lambda: job.stage != "film") == {"PASS_THROUGH"}
    assert job.said.left
    bpy.ops.sacha.cancel()
    assert tick_while(lambda: True) == {"CANCELLED"}
    assert job.process.poll() is not None
    footage = tmp_path / "film" / "footage"
    assert 1 <= len(list(footage.glob("00*.png"))) < 9
    assert not setup.dataset


FILMED_THEN_CRASHED = f"""
import json, os, sys
told = json.load(open(sys.argv[1]))
n_images = len(told["frames"]) * len(told["cameras"]) - {{missing}}
os.makedirs(told["root"])
json.dump({{{{"capture": told["root"], "n_images": n_images, "n_timesteps": 1}}}}, open(told["report"], "w"))
print(json.dumps({{{{"finished": True}}}}), flush=True)
os.kill(os.getpid(), {int(signal.SIGSEGV)})
"""


@pytest.mark.parametrize("missing", [0, 1])
def test_a_blender_that_crashes_after_its_film_is_whole_is_no_failure(
    studio: bpy.types.Object, addon: ModuleType, missing: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    film_head = __import__(f"{addon.__name__}.making.film_head", fromlist=["WORKER"])
    worker = tmp_path / "worker.py"
    worker.write_text(FILMED_THEN_CRASHED.format(missing=missing))
    monkeypatch.setattr(film_head, "WORKER", worker)
    bpy.ops.sacha.add_cameras(count=2)
    bpy.context.scene.frame_end = 1
    folder = str(tmp_path / "film")
    if missing:
        with pytest.raises(RuntimeError, match="has 1 of 2 pictures: film it again"):
            bpy.ops.sacha.film(directory=folder)
        assert not bpy.context.scene.sacha_making.dataset
        return
    assert bpy.ops.sacha.film(directory=folder) == {"FINISHED"}
    assert bpy.context.scene.sacha_making.dataset == folder
    assert "All was written when the Blender that filmed crashed at its end (signal 11)" in capfd.readouterr().out


def test_a_folder_with_other_files_is_left_alone(studio: bpy.types.Object, tmp_path: Path) -> None:
    other = tmp_path / "film" / "footage" / "holiday.png"
    other.parent.mkdir(parents=True)
    other.write_text("precious")
    with pytest.raises(RuntimeError, match="holds files that are no footage: choose another folder"):
        bpy.ops.sacha.film()
    assert other.read_text() == "precious"


def test_what_is_missing_is_said(addon: ModuleType, opened: bpy.types.Object, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="0 cameras to film from: Add Cameras makes a set of them"):
        bpy.ops.sacha.film(directory=str(tmp_path))
    bpy.ops.sacha.add_cameras(count=2)
    with pytest.raises(RuntimeError, match="No dataset: name the folder that it goes to"):
        bpy.ops.sacha.film()
    cameras = [thing for thing in bpy.context.scene.objects if thing.type == "CAMERA"]
    cameras[0].data.type = "ORTHO"
    with pytest.raises(RuntimeError, match="has no perspective"):
        bpy.ops.sacha.film(directory=str(tmp_path / "film"))
    bpy.ops.mesh.primitive_cube_add()
    for operator in (bpy.ops.sacha.film, bpy.ops.sacha.add_cameras):
        with pytest.raises(RuntimeError, match="No head: open one, or select the mesh of one that is open"):
            operator()


def test_cameras_surround_the_face_and_see_all_of_it(opened: bpy.types.Object) -> None:
    """Oracle: Blender's own projection of the head's corners, and angles by their definition."""
    from bpy_extras.object_utils import world_to_camera_view  # noqa: PLC0415

    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    bpy.ops.sacha.add_cameras(count=16, arc_deg=112.0, elevation_deg=16.0, distance=1.0)
    bpy.ops.sacha.add_cameras(count=16, arc_deg=112.0, elevation_deg=16.0, distance=1.0)  # in the place of the others
    cameras = [thing for thing in scene.objects if thing.type == "CAMERA"]
    bpy.context.view_layer.update()
    assert len(cameras) == 16 == len(bpy.data.cameras)
    corners = [opened.matrix_world @ Vector(corner) for corner in opened.bound_box]
    middle = sum(corners, Vector()) / 8
    azimuths, elevations = [], []
    for camera in cameras:
        seen = [world_to_camera_view(scene, camera, corner) for corner in corners]
        assert all(0 <= point.x <= 1 and 0 <= point.y <= 1 and point.z > 0 for point in seen)
        away = camera.matrix_world.translation - middle
        assert math.isclose(away.length, 1.0, abs_tol=1e-5)
        azimuths.append(math.degrees(math.atan2(away.x, -away.y)))
        elevations.append(round(math.degrees(math.asin(away.z)), 3))
    assert math.isclose(min(azimuths), -56.0, abs_tol=1e-3)
    assert math.isclose(max(azimuths), 56.0, abs_tol=1e-3)
    assert sorted({*elevations}) == [-16.0, 0.0, 16.0]
    assert sum(abs(a) < 1e-3 and e == 0 for a, e in zip(azimuths, elevations, strict=True)) == 1
