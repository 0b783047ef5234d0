"""The commands one after the other on a tiny head: frames in, a small file out, decoded, drawn and judged."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import get_args

import av
import numpy as np
import pytest
from PIL import Image

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.cli.common import HeadSource
from sacha_core.cli.encode import times_as_much
from sacha_core.cli.sources import open_avatar
from sacha_core.cli.train import Variant
from sacha_core.codec import decode, encode, encode_archive
from sacha_core.codec.levels import MAX_QUALITY, level_at
from sacha_core.flame.head_file import load_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.shelf import find_head
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.capture import read_capture, read_head_reference
from sacha_core.interchange.gaussian_avatars import read_flame_param, read_model
from sacha_core.interchange.splat_ply import read_bound_ply, write_bound_ply
from sacha_core.npz import write_npz
from sacha_core.rate.encoding import RenderingEncoder
from sacha_core.rate.judging import Judge
from sacha_core.rate.target import encode_to_psnr
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme_file import write_scheme_file
from sacha_core.train.cuda.available import missing
from sacha_core.train.presets import VARIANTS

Call = Callable[..., object]

WAYS = ((), ("--no-rendering",))


def test_synth_makes_what_was_asked_for(synthesised) -> None:
    folder, outcome = synthesised
    capture = read_capture(folder)
    assert len(capture.train) == 3 * 3
    assert len(capture.val) == 3
    assert len(capture.test) == 2 * 4
    assert {view.camera_index for view in capture.val} == {8}
    assert capture.image(capture.train[0]).shape == (94, 64, 3)
    assert outcome.report["n_images"] == 20
    assert Path(outcome.report["capture"]) == capture.root
    assert capture.head == synthetic_head("small").reference


def test_synth_keeps_what_is_there(done, capture: Path) -> None:
    images = sorted(capture.glob("*/images/*.png"))
    before = [image.stat().st_mtime_ns for image in images]
    again = done(
        *("synth", capture, "--head", "synthetic:small", "--width", 64, "--height", 94, "--cameras", 0, 5, 8, 11),
        *("--timesteps", 3, "--test-timesteps", 2, "--sequences", "EMO-1", "--supersample", 1),
    )
    assert "kept         2 of 2" in again.out
    assert [image.stat().st_mtime_ns for image in images] == before


def test_train_writes_a_model_that_others_read(trained) -> None:
    folder, outcome = trained
    gaussians, motion = read_model(folder)
    gaussians.validate(synthetic_head("small").n_faces)
    assert motion is not None
    assert len(motion) == 5
    assert outcome.report["n_gaussians"] == len(gaussians) == sum(outcome.report["per_region"].values())
    assert outcome.report["iterations"] == 100
    assert json.loads((folder / "head.json").read_text())["name"] == "synthetic-small-0"


def test_train_knows_every_variant() -> None:
    assert get_args(Variant) == VARIANTS


def test_train_refuses_two_lengths(refused, capture: Path, tmp_path: Path) -> None:
    line = refused("train", capture, "-o", tmp_path / "m", "--preset", "paper", "--iterations", 10)
    assert "--iterations" in line
    assert not (tmp_path / "m").exists()


def test_encode_says_where_the_bytes_are(encoded, model: Path) -> None:
    file, outcome = encoded
    counts = outcome.report["bytes"]
    assert counts["total"] == file.stat().st_size
    assert counts["gaussians"] + counts["motion"] + counts["head"] == counts["total"]
    assert counts["head"] == 0
    assert outcome.report["n_frames"] == 5
    assert outcome.report["n_gaussians"] + outcome.report["n_gaussians_left_out"] == len(read_model(model)[0])


def test_levels_grow(done, model: Path, tmp_path: Path) -> None:
    sizes = [
        done("encode", model, "--level", level, "-o", tmp_path / "a.sacha").report["bytes"]["total"]
        for level in (1, 2, 3, 4)
    ]
    assert sizes == sorted(set(sizes))


def test_targets_are_kept(done, refused, model: Path, tmp_path: Path) -> None:
    """Oracle: the library's own search for a quality, which `tests/rate/test_target.py` holds to it."""
    file = tmp_path / "a.sacha"
    report = done("encode", model, "--target-size", "4KB", "-o", file).report
    assert 0.9 * 4000 < report["bytes"]["total"] == file.stat().st_size <= 4000
    near = done("encode", model, "--target-psnr", 35, "-o", file)
    avatar, head = opened(model)
    expected = encode_to_psnr(RenderingEncoder(avatar, head), Judge(avatar, head), 35)
    assert file.read_bytes() == expected.encoded.data
    assert near.report["psnr_db"] == expected.psnr_db >= 35
    assert f"{near.report['psnr_db']:.2f} dB" in near.out
    before = file.read_bytes()
    assert "out of reach; the smallest" in refused("encode", model, "--target-size", 500, "-o", file)
    assert "a size of 'much'" in refused("encode", model, "--target-size", "much", "-o", file)
    assert file.read_bytes() == before


def test_a_size_beyond_the_best_file_is_told_with_what_that_reaches(done, model: Path, tmp_path: Path) -> None:
    """Oracle: the library's file of the highest quality, and its judge."""
    file, (avatar, head) = tmp_path / "a.sacha", opened(model)
    outcome = done("encode", model, "--target-size", "3MB", "-o", file)
    best = RenderingEncoder(avatar, head).encode(level_at(MAX_QUALITY)).data
    assert file.read_bytes() == best
    assert outcome.report["psnr_db"] == Judge(avatar, head).full(decode(best, head=head).gaussians)
    assert f"{outcome.report['psnr_db']:.2f} dB from" in outcome.out
    assert "3MB is more than this avatar takes: the file is of the best quality there is" in outcome.out
    assert "more bytes" not in done("encode", model, "--target-size", "4KB", "-o", file).out


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (0.34, "0.3 times as much"),
        (0.96, "as much"),
        (1.04, "as much"),
        (1.2, "1.2 times as much"),
        (1.96, "2 times as much"),
        (37.4, "37 times as much"),
    ],
)
def test_times_are_said_as_people_say_them(factor: float, said: str) -> None:
    assert times_as_much(factor) == said


def test_one_of_something_is_said_as_one(done, tmp_path: Path) -> None:
    """One frame, one Gaussian of two that is worth its bits, one group."""
    head = synthetic_head("small")
    gaussians = initial_gaussians(head.n_faces, np.random.default_rng(0), 0).select(np.arange(2))
    gaussians.opacity_logit[:] = [3.0, -30.0]
    motion = Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2])
    (tmp_path / "a.sacha").write_bytes(encode_archive(Avatar(gaussians, head.reference, motion)))
    file = tmp_path / "b.sacha"
    told = done("encode", tmp_path / "a.sacha", "--head", "synthetic:small", "--no-rendering", "-o", file).out
    assert " for 1 (1 that is not worth its bits was left out); as PLY" in told
    assert " for 1 frame, " in told
    assert f"1 frame at {motion.frame_rate:g} a second, playable from 1 place\n" in done("inspect", file).out
    decoded = done("decode", file, "--head", "synthetic:small", "--ply", tmp_path / "b.ply").out
    assert f"{file}: 1 Gaussian on head {head.name!r}, 1 frame\n" in decoded


def opened(model: Path) -> tuple[Avatar, HeadModel]:
    gaussians, motion = read_model(model)
    head = find_head(read_head_reference(model)[0], None, None)
    return Avatar(gaussians, head.reference, motion), head


def test_encode_measures_what_it_says(done, model: Path, tmp_path: Path) -> None:
    """Oracle: the library's own judge, of what comes out of the decoder."""
    file = tmp_path / "a.sacha"
    avatar, head = opened(model)
    for more in ((), ("--no-rendering",), ("--profile", "paper"), ("--level", "archive")):
        report = done("encode", model, "--measure", *more, "-o", file).report
        expected = Judge(avatar, head).full(decode(file, head=head).gaussians)
        assert report["psnr_db"] == pytest.approx(expected, abs=1e-3)
        assert sum(report["sections"].values()) < report["bytes"]["total"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--target-size", "20KB", "--target-psnr", "35"), "one of --target-size and --target-psnr"),
        (("--target-size", "20KB", "--level", "3"), "--level says how good the file is"),
        (("--target-psnr", "35", "--no-rendering"), "which --no-rendering does not"),
        (("--tune", "--profile", "paper"), "which --profile paper does not"),
        (("--dataset", "D", "--target-psnr", "35"), "--dataset with --target-psnr is not possible"),
        (("--scheme", __file__), "expected --weights REGION=FACTOR beside it"),
    ],
)
def test_contradictory_options_of_encode_are_refused(refused, model: Path, tmp_path: Path, options, said: str) -> None:
    assert said in refused("encode", model, *options, "-o", tmp_path / "a.sacha")


def test_weights_of_regions_of_ones_own(done, refused, model: Path, tmp_path: Path) -> None:
    """Oracle: the encoder, told the factors themselves."""
    avatar, head = opened(model)
    labels = (np.arange(head.n_faces) % 2).astype(np.uint8)
    own, file = tmp_path / "own.scheme.npz", tmp_path / "a.sacha"
    write_scheme_file(own, Partition("own", ("even", "odd"), ((0, 0, 0), (255, 255, 255)), labels))
    done("encode", model, "--weights", "odd=8", "--scheme", own, "-o", file)
    factors = np.where(labels[avatar.gaussians.binding] == 1, 8.0, 1.0)
    expected = RenderingEncoder(avatar, head, factors=factors).encode(2).data
    assert file.read_bytes() == expected
    assert "has no region 'mouth'" in refused("encode", model, "--weights", "mouth=8", "--scheme", own, "-o", file)


@pytest.mark.parametrize("plain", ["--level archive", "--profile paper"])
def test_no_rendering_where_nothing_is_rendered_changes_nothing_and_is_told(
    done, model: Path, tmp_path: Path, plain: str
) -> None:
    files = [tmp_path / "without.sacha", tmp_path / "with.sacha"]
    told = [
        done("encode", model, *plain.split(), *more, "-o", file).out for file, more in zip(files, WAYS, strict=True)
    ]
    assert files[0].read_bytes() == files[1].read_bytes()
    said = f"--no-rendering changes nothing: {plain} never looks at pictures"
    assert [said in out for out in told] == [False, True]
    assert said not in done("encode", model, "--no-rendering", "-o", files[0]).out


def test_a_motion_that_the_head_cannot_follow_is_encoded_without_pictures_alone(
    done, refused, model: Path, tmp_path: Path
) -> None:
    (avatar, _), path = opened(model), tmp_path / "a.sacha"
    motion = avatar.motion
    wide = np.concatenate([motion.expression, np.ones((len(motion), 1), np.float32)], axis=1)
    path.write_bytes(encode_archive(replace(avatar, motion=replace(motion, expression=wide))))
    said = refused("encode", path, "-o", tmp_path / "b.sacha")
    assert f"component {motion.expression.shape[1]} is 1 at row 0; --no-rendering encodes it" in said
    done("encode", path, "--no-rendering", "-o", tmp_path / "b.sacha")
    assert decode(tmp_path / "b.sacha").motion.expression.shape == wide.shape


def test_archive_gives_back_the_model_bit_for_bit(done, model: Path, tmp_path: Path) -> None:
    file, ply = tmp_path / "a.sacha", tmp_path / "a.ply"
    done("encode", model, "--level", "archive", "-o", file)
    done("decode", file, "--ply", ply)
    given, back = read_model(model)[0], read_bound_ply(ply)
    for name in ("position", "log_scale", "quaternion", "opacity_logit", "sh_dc", "sh_rest", "binding"):
        assert getattr(back, name).tobytes() == getattr(given, name).tobytes(), name
    assert "archive: every bit" in done("inspect", file).out


@pytest.mark.parametrize("degree", range(4))
def test_a_ply_comes_back_from_its_archive_byte_for_byte_and_is_read(done, degree: int, tmp_path: Path) -> None:
    """Oracle: the file that was given, whose harmonics are of every degree that there is."""
    head, given, back = ("--head", "synthetic:small"), tmp_path / "given.ply", tmp_path / "back.ply"
    rng = np.random.default_rng(degree)
    gaussians = initial_gaussians(synthetic_head("small").n_faces, rng, degree)
    write_bound_ply(given, replace(gaussians, sh_rest=rng.normal(size=gaussians.sh_rest.shape).astype("f4")), degree)
    done("encode", "--ply", given, *head, "--level", "archive", "-o", tmp_path / "a.sacha")
    done("decode", tmp_path / "a.sacha", *head, "--ply", back)
    assert back.read_bytes() == given.read_bytes()
    done("scene", back, *head, "--out", tmp_path / "scene")
    done("export", back, *head, "--format", "ply", "-o", tmp_path / "world.ply")
    done("decode", tmp_path / "a.sacha", *head, "--model", tmp_path / "model")
    assert read_model(tmp_path / "model")[0].sh_degree == 3  # as GaussianAvatars insists


def test_paper_profile_tells_its_coder(done, refused, model: Path, tmp_path: Path) -> None:
    file = tmp_path / "a.sacha"
    done("encode", model, "--profile", "paper", "--level", 3, "-o", file)
    outcome = done("inspect", file)
    assert (outcome.report["profile"], outcome.report["level"], outcome.report["coder"]) == ("paper", 3, "own coder")
    assert "own coder" in outcome.out
    done("render", file, "--frame", 0, "-o", tmp_path / "a.png", "--width", 40, "--height", 50)
    assert "level archive" in refused("encode", model, "--profile", "paper", "--level", "archive", "-o", file)
    assert "--profile paper" in refused("encode", model, "--tmc3", model / "head.json", "-o", file)


def test_inspect_accounts_for_every_byte(done, sacha_file: Path) -> None:
    outcome = done("inspect", sacha_file)
    sections = outcome.report["sections"]
    last = max(sections, key=lambda one: one["offset"])
    assert last["offset"] + last["n_bytes"] == sacha_file.stat().st_size == outcome.report["bytes"]["total"]
    for section in sections:
        assert f"{section['name']} " in outcome.out
        assert f"{section['n_bytes']:,}" in outcome.out
    assert outcome.report["head"]["name"] == "synthetic-small-0"


def test_decode_gives_back_what_the_codec_decodes(done, sacha_file: Path, tmp_path: Path) -> None:
    ply, motion, folder = tmp_path / "b.ply", tmp_path / "m.npz", tmp_path / "model"
    outcome = done("decode", sacha_file, "--ply", ply, "--motion", motion, "--model", folder)
    avatar = decode(sacha_file)
    back = read_bound_ply(ply)
    for name in ("position", "log_scale", "quaternion", "opacity_logit", "sh_dc", "binding"):
        np.testing.assert_array_equal(getattr(back, name), getattr(avatar.gaussians, name))
    np.testing.assert_array_equal(read_flame_param(motion).expression, avatar.motion.expression)
    again = done("encode", folder, "-o", tmp_path / "again.sacha")
    assert again.report["n_gaussians"] + again.report["n_gaussians_left_out"] == outcome.report["n_gaussians"]


def without(packages: tuple[str, ...], *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own where some packages are not installed."""
    code = (
        "import sys\n"
        "from importlib.machinery import PathFinder\n"
        "find = PathFinder.find_spec\n"
        "def find_others(name, path=None, target=None):\n"
        f"    return None if name.split('.')[0] in {packages!r} else find(name, path, target)\n"
        "PathFinder.find_spec = find_others\n"
        "from sacha_core.cli import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def test_decoding_needs_neither_torch_nor_numba(sacha_file: Path, tmp_path: Path) -> None:
    found = without(("torch", "trimesh", "numba", "xatlas"), "decode", sacha_file, "--ply", tmp_path / "b.ply")
    assert found.returncode == 0, found.stderr
    back, same = read_bound_ply(tmp_path / "b.ply"), decode(sacha_file).gaussians
    np.testing.assert_array_equal(back.position, same.position)


def test_drawing_needs_no_torch(sacha_file: Path, tmp_path: Path) -> None:
    found = without(("torch", "trimesh"), "render", sacha_file, "-o", tmp_path / "a.png")
    assert found.returncode == 0, found.stderr


def test_training_on_the_processor_needs_no_torch(capture: Path, tmp_path: Path) -> None:
    found = without(("torch",), "train", capture, "-o", tmp_path / "m", "--iterations", 2)
    assert found.returncode == 0, found.stderr


def test_decode_wants_to_know_where_to(refused, sacha_file: Path) -> None:
    assert "--ply" in refused("decode", sacha_file)


def picture(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(float)


def test_render_draws_what_the_camera_saw(done, capture: Path, sacha_file: Path, model: Path, tmp_path: Path) -> None:
    """A few iterations make no likeness, but the head must be where the photograph has it."""
    view = read_capture(capture).val[1]
    for source in (sacha_file, model):
        path = tmp_path / f"{source.stem}.png"
        done("render", source, "--dataset", capture, "--camera", 8, "--frame", view.timestep, "-o", path)
        drawn, truth = picture(path).min(axis=2) < 230, picture(view.image_path).min(axis=2) < 230
        assert drawn.shape == (94, 64)
        assert (drawn & truth).sum() / (drawn | truth).sum() > 0.6


def test_render_places_cameras_side_by_side(done, sacha_file: Path, tmp_path: Path) -> None:
    both, left = tmp_path / "both.png", tmp_path / "left.png"
    size = ("--width", 40, "--height", 60)
    done("render", sacha_file, "-o", both, "--azimuth", -40, 30, *size)
    done("render", sacha_file, "-o", left, "--azimuth", -40, *size)
    np.testing.assert_array_equal(picture(both)[:, :40], picture(left))
    assert picture(both).shape == (60, 80, 3)
    assert np.abs(picture(both)[:, 40:] - picture(left)).max() > 20


def test_render_by_region_shows_the_regions_colours(done, sacha_file: Path, tmp_path: Path) -> None:
    plain, regions = tmp_path / "plain.png", tmp_path / "regions.png"
    done("render", sacha_file, "-o", plain)
    done("render", sacha_file, "-o", regions, "--colour", "region")
    assert picture(regions).shape == (802, 550, 3)

    def colourfulness(path: Path) -> float:
        image = picture(path)
        return float((image.max(axis=2) - image.min(axis=2)).mean())

    assert colourfulness(regions) > 2 * colourfulness(plain)


def test_render_by_region_goes_by_the_avatars_own_scheme(done, sacha_file: Path, tmp_path: Path) -> None:
    """Regions differ where the scheme does, and what the avatar looks like does not."""
    avatar, head = decode(sacha_file.read_bytes(), head=synthetic_head("small")), synthetic_head("small")
    pictures = {}
    for scheme in ("paper", "wide-eyes"):
        file = tmp_path / f"{scheme}.sacha"
        file.write_bytes(encode(replace(avatar, scheme=scheme), 4, head=head))
        for colour in ("rgb", "region"):
            pictures[scheme, colour] = tmp_path / f"{scheme}-{colour}.png"
            done("render", file, "-o", pictures[scheme, colour], "--colour", colour, "--head", "synthetic:small")
    np.testing.assert_array_equal(picture(pictures["paper", "rgb"]), picture(pictures["wide-eyes", "rgb"]))
    assert np.abs(picture(pictures["paper", "region"]) - picture(pictures["wide-eyes", "region"])).max() > 20


def test_render_writes_a_video(done, sacha_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    outcome = done(
        "render", sacha_file, "--video", path, "--frames", "1:5:2", "--orbit", 90, "--width", 32, "--height", 48
    )
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert (stream.width, stream.height) == (32, 48)
        assert float(stream.average_rate) == pytest.approx(12.5)
        images = [frame.to_ndarray(format="rgb24").astype(float) for frame in container.decode(stream)]
    assert len(images) == outcome.report["n_frames"] == 2
    assert np.abs(images[0] - images[1]).max() > 50


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ((), "-o FILE.png"),
        (("-o", "a.png", "--video", "a.mp4"), "-o FILE.png"),
        (("-o", "a.png", "--frame", 99), "frames 0 to 4"),
        (("-o", "a.png", "--frame", -1), "frames 0 to 4"),
        (("-o", "a.xyz"), "a.xyz"),
        (("-o", "a.png", "--width", 0), "--width"),
        (("-o", "a.png", "--height", 100_000), "--height"),
        (("-o", "a.png", "--distance", 0.01), "--distance"),
        (("-o", "a.png", "--azimuth", "inf"), "--azimuth"),
        (("-o", "a.png", "--azimuth", 0, "nan"), "--azimuth"),
        (("-o", "a.png", "--focal", "nan"), "--focal"),
        (("-o", "a.png", "--azimuth"), "--azimuth"),
        (("-o", "a.png", "--dataset", "d", "--camera"), "--camera"),
        (("-o", "a.png", "--dataset", "d", "--elevation", 9), "--elevation"),
        (("-o", "a.png", "--camera", 3), "--dataset"),
        (("-o", "a.png", "--frames", "0:2"), "--frame N"),
        (("-o", "a.png", "--orbit", 90), "--azimuth"),
        (("--video", "a.mp4", "--frame", 2), "--frames FROM:TO"),
        (("--video", "a.mp4", "--frames", "7:9"), "--frames 7:9"),
        (("--video", "a.mp4", "--frames", "x"), "--frames x"),
        (("--video", "a.mp4", "--frames", "::0"), "--frames ::0"),
        (("--video", "a.txt"), ".mp4"),
    ],
)
def test_render_refuses_what_makes_no_sense(
    refused, sacha_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: tuple[object, ...], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused("render", sacha_file, *wrong)
    assert not list(tmp_path.iterdir())


def test_evaluate_judges_both_splits(done, capture: Path, sacha_file: Path, model: Path) -> None:
    original = done("evaluate", model, capture).report
    decoded = done("evaluate", sacha_file, capture).report
    for report in (original, decoded):
        for name, count in (("novel_view", 3), ("novel_expression", 8)):
            images = report[name]["images"]
            assert len(images) == count
            assert report[name]["psnr"] == pytest.approx(np.mean([one["psnr"] for one in images]))
            assert 8 < report[name]["psnr"] < 40
            assert 0 < report[name]["ssim"] < 1
        assert {one["camera_index"] for one in report["novel_view"]["images"]} == {8}
    assert decoded["novel_view"]["psnr"] == pytest.approx(original["novel_view"]["psnr"], abs=0.3)


def test_progress_of_a_command_is_json_alone(done, capture: Path, model: Path) -> None:
    outcome = done("evaluate", model, capture, "--progress", "json", "--width", 32, "--height", 47)
    _hello, *lines = [json.loads(line) for line in outcome.out.splitlines()]
    ends = [(one["stage"], one["done"], one["total"]) for one in lines if one["done"] == one["total"]]
    assert ends == [("novel view", 3, 3), ("novel expression", 8, 8)]
    assert outcome.report["novel_view"]["images"]


def test_convert_head_keeps_the_head(done, tmp_path: Path) -> None:
    outcome = done("convert-head", "synthetic:small", "-o", tmp_path / "head.npz")
    head = synthetic_head("small")
    assert outcome.report["sha256"] == head.reference.sha256
    assert sum(outcome.report["region_triangles"].values()) == head.n_faces
    again = done("convert-head", tmp_path / "head.npz", "-o", tmp_path / "again.npz")
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "head.npz").read_bytes()
    assert again.report["name"] == "synthetic-small-0"
    assert not again.report["unwrapped"]


def test_convert_head_of_a_rig_that_tells_no_regions(done, tmp_path: Path) -> None:
    head = synthetic_head("small")
    write_npz(tmp_path / "rig.npz", {"verts": head.v_template, "faces": head.faces, "mask_neck": head.masks["neck"]})
    outcome = done("convert-head", tmp_path / "rig.npz", "-o", tmp_path / "head.npz")
    assert outcome.report["region_triangles"] == {}
    assert "regions      unknown: head 'rig' has no vertex mask boundary, eye_region" in outcome.out
    assert "--masks FLAME_masks.pkl" in outcome.out
    converted = load_head(tmp_path / "head.npz")
    assert converted.masks.keys() == {"neck"}
    assert outcome.report["unwrapped"]
    assert converted.uv_faces.shape == head.faces.shape


def test_evaluate_sets_an_avatar_beside_what_papers_report(done, capture: Path, sacha_file: Path, model: Path) -> None:
    outcome = done("evaluate", sacha_file, capture, "--table-one")
    told, found = outcome.report["table_one"], done("inspect", sacha_file).report
    assert told["bytes"]["file"] == found["bytes"]["total"] - found["bytes"]["head"]
    assert told["psnr"] == outcome.report["novel_expression"]["psnr"]
    assert "GaussianAvatars" in outcome.out
    assert "100.08  25.5097  0.9102  0.1103" in outcome.out
    assert "no LPIPS" in outcome.out
    saved = done("evaluate", model, capture, "--table-one").report["table_one"]["bytes"]
    opened = open_avatar(model, HeadSource())
    n_vertices, n_frames = opened.head.n_vertices, len(opened.avatar.motion)
    assert saved["model_with_zero_offset"] - saved["model"] == 12 * n_vertices * n_frames
    assert saved["model"] == 252 * len(opened.avatar.gaussians) + 4 * (300 + 3 * n_vertices + 118 * n_frames)


def test_doctor_lists_packages(done) -> None:
    outcome = done("doctor")
    assert outcome.report["packages"]["numpy"] == np.__version__
    assert ["numpy", np.__version__] in [line.split()[:2] for line in outcome.out.splitlines()]
    lack = missing()
    assert (outcome.report["device"], outcome.report["no_cuda_because"]) == ("cuda" if lack is None else "cpu", lack)
    assert (lack or "training     on the CUDA device") in outcome.out


def test_doctor_finds_the_head_inside_the_masks(done, capture: Path) -> None:
    outcome = done("doctor", capture)
    assert outcome.report["splits"] == {"train": 9, "val": 3, "test": 8}
    assert outcome.report["coverage_worst"] > 0.8
    assert outcome.report["warnings"] == []
    assert "warning" not in outcome.out


def test_doctor_draws_the_track_and_names_wrong_cameras(done, call, capture: Path, tmp_path: Path) -> None:
    outcome = done("doctor", capture, "--picture", tmp_path / "track.png")
    assert outcome.report["findings"] == []
    assert "verdict      fit for training" in outcome.out
    assert (tmp_path / "track.png").stat().st_size > 1000
    root = tmp_path / "capture"
    shutil.copytree(capture, root)
    for path in root.rglob("transforms_*.json"):  # OpenCV's axes, as calibrations come
        told = json.loads(path.read_text())
        for frame in told["frames"]:
            frame["transform_matrix"] = (np.array(frame["transform_matrix"]) * [1, -1, -1, 1]).tolist()
        path.write_text(json.dumps(told))
    wrong = call("doctor", root)
    assert wrong.status == 1
    assert "if cameras are camera to world in OpenCV's axes" in wrong.out
    assert "verdict      not fit for training: 1 error" in wrong.out
    assert "Traceback" not in wrong.err


def test_doctor_says_where_versions_of_flame_are_not_compared(
    done, capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path / "none"))  # another head that takes these parameters may be known
    root = tmp_path / "capture"
    shutil.copytree(capture, root)
    for path in root.rglob("head.json"):  # what VHAP exports does not say its head
        path.unlink()
    outcome = done("doctor", root, "--head", "synthetic:small")
    assert outcome.report["heads_held_against"] == 0
    assert "versions     not compared" in outcome.out
    assert "versions" not in done("doctor", capture).out


def test_doctor_says_what_a_folder_is_that_is_no_capture(refused, model: Path, tmp_path: Path) -> None:
    (tmp_path / "tracked_flame_params_30.npz").touch()
    assert "VHAP's export_as_nerf_dataset.py" in refused("doctor", tmp_path)
    said = refused("doctor", model)
    assert "is a trained model, not a capture" in said
    assert "sacha evaluate" in said


def test_one_side_alone_would_squeeze(refused, capture, model, tmp_path):
    for command in (("train", capture, "-o", tmp_path / "m"), ("evaluate", model, capture)):
        assert "--height without --width" in refused(*command, "--height", 40)
    looked = ("render", model, "-o", tmp_path / "a.png", "--dataset", capture)
    assert "--width without --height" in refused(*looked, "--width", 40)
    assert not (tmp_path / "m").exists()
    assert not (tmp_path / "a.png").exists()
