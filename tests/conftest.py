"""What every test may ask for: hypothesis without surprises, and real material where it lies beside the checkout."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from jaxtyping import install_import_hook

SHAPED = (
    "avatar",
    "density",
    "evaluate",
    "flame",
    "geometry",
    "interchange",
    "regions",
)  # those without compiled kernels
CHECK_SHAPES = os.environ.get("SACHA_CHECK_SHAPES") == "1"  # hold every call to the shapes that its annotations promise

if CHECK_SHAPES:
    install_import_hook([f"sacha_core.{package}" for package in SHAPED], "beartype.beartype")

settings.register_profile(
    "sacha",
    derandomize=True,
    deadline=None,
    max_examples=40,
    suppress_health_check=[HealthCheck.too_slow],
    database=None,
)
settings.load_profile("sacha")


@pytest.fixture(scope="session", autouse=True)
def _no_heads_of_the_user(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep what is made once for all tests apart from the user's heads; such fixtures come before those of a file."""
    with own_heads(tmp_path_factory):
        yield


@pytest.fixture(scope="module", autouse=True)
def _own_heads(_no_heads_of_the_user: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the heads that one file of tests uses apart from those of other files, whatever ran before it."""
    with own_heads(tmp_path_factory):
        yield


@contextmanager
def own_heads(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep heads in a new folder for as long as this lasts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SACHA_HEADS", str(tmp_path_factory.mktemp("heads")))
        yield


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Give the folder of real material, or skip; SACHA_REQUIRE_REAL_DATA=1 turns the skip into a failure."""
    folder = Path(os.environ.get("SACHA_REAL_DATA", Path(__file__).parents[2] / "shared" / "data"))
    if not folder.is_dir():
        if os.environ.get("SACHA_REQUIRE_REAL_DATA") == "1":
            pytest.fail(f"SACHA_REQUIRE_REAL_DATA is set and {folder} does not exist")
        pytest.skip(f"real material is not at {folder}; SACHA_REAL_DATA names another place")
    return folder
