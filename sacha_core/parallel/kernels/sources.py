"""Which files a kernel is compiled from: its own, and all of this package that it imports from, directly or not."""

from __future__ import annotations

import re
from functools import cache
from hashlib import sha256
from pathlib import Path

__all__ = ["source_files", "sources_changed", "sources_key"]

ROOT = Path(__file__).parents[2]
IMPORT = re.compile(
    rf"^[ \t]*(?:from|import)[ \t]+({ROOT.name}[\w.]*)(?:[ \t]+import[ \t]+(\([^)]*\)|[^\n(]*))?", re.MULTILINE
)


def read(file: Path) -> tuple[bytes, list[Path]]:
    """Give the digest of a file, and the files of this package that it names in its imports: modules, packages, parts of packages."""
    text = file.read_bytes()
    names: list[str] = []
    for module, parts in IMPORT.findall(text.decode()):
        names += [module, *(f"{module}.{part}" for part in re.findall(r"\w+", parts) if part.islower())]
    places = [ROOT.parent.joinpath(*name.split(".")) for name in names]
    imported = [path for place in places for path in (place.with_suffix(".py"), place / "__init__.py")]
    return sha256(text).digest(), [path for path in imported if path.is_file()]


read_once = cache(read)


def source_files(file: Path, read=read) -> dict[Path, bytes]:
    """Give the digests of a module's file and of those of this package that it imports from, found in their texts.

    Raises:
        OSError: a file cannot be read.
    """
    found: dict[Path, bytes] = {}
    open_ends = [file]
    while open_ends:
        file = open_ends.pop()
        if file not in found:
            found[file], imported = read(file)
            open_ends += imported
    return found


@cache
def sources_key(file: Path) -> str:
    """Give the digest of all that a module's kernels are compiled from, as each file was when first asked for."""
    return joined(source_files(file, read_once))


def sources_changed(file: Path) -> bool:
    """Tell whether a file is another by now, or gone."""
    try:
        return joined(source_files(file)) != sources_key(file)
    except OSError:
        return True


def joined(digests: dict[Path, bytes]) -> str:
    """Give one digest of many, wherever the package lies."""
    return sha256(b"".join(digests[file] for file in sorted(digests))).hexdigest()
