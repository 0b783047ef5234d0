# SPDX-License-Identifier: GPL-3.0-or-later
"""What a mesh shows, kept with it in the .blend."""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..active import mesh_of
from . import painting, selecting

__all__ = ["CLASSES", "SORTS", "TABLES", "attach", "detach", "edited", "shown_by"]

NOTHING = ("NONE", "Nothing", "Nothing is known of its triangles", 0)
SORTS = (  # property of a row, heading, what it is
    ("place", "Region", "In the order of the scheme"),
    ("gaussians", "Count", "Gaussians of the region"),
    ("share", "Share", "Part of all Gaussians"),
    ("n_bytes", "Bytes", "Bytes of the file that describe the region's Gaussians"),
    ("before", "Before", "Gaussians that the region had before"),
    ("change", "Change", "Gaussians more than before"),
    ("before_bytes", "Before", "Bytes that the region's Gaussians took before"),
    ("bytes_change", "Change", "Bytes more than before"),
)
TABLES = (  # name, label, what it says, its columns: three, which is what a sidebar has room for
    ("NOW", "Now", "Gaussians of each region, their share of all, their bytes", ("gaussians", "share", "n_bytes")),
    ("COUNT", "Count", "Gaussians before and now", ("before", "gaussians", "change")),
    ("BYTES", "Bytes", "Bytes before and now", ("before_bytes", "n_bytes", "bytes_change")),
)
_items: dict[
    tuple[tuple[str, str, str], ...], list[tuple[str, str, str, int]]
] = {}  # Blender keeps no reference of its own


def _views(shown: SachaShown, context: bpy.types.Context | None) -> list[tuple[str, str, str, int]]:  # noqa: ARG001
    """Give the views that the mesh has, in their order."""
    key = tuple((view.name, view.label, view.about) for view in shown.views)
    if key not in _items:
        _items[key] = [(name.upper(), label, about, place) for place, (name, label, about) in enumerate(key)]
    return _items[key] or [NOTHING]


def _view_changed(shown: SachaShown, context: bpy.types.Context) -> None:  # noqa: ARG001  (Blender's signature)
    """Show the colours of the view that was chosen."""
    painting.paint(shown.id_data)


def _region_chosen(shown: SachaShown, context: bpy.types.Context) -> None:  # noqa: ARG001  (Blender's signature)
    """Select the faces of the region whose row was chosen."""
    if 0 <= shown.active_region < len(shown.regions):
        selecting.select_faces(shown.id_data, {shown.regions[shown.active_region].place}, extend=False)


def _kept(line: bpy.types.PropertyGroup) -> tuple[float, float, float]:
    """Give the colour of a line."""
    return tuple(line.kept)


def _keep_as_it_is(line: bpy.types.PropertyGroup, colour: tuple[float, float, float]) -> None:
    """Let a click on a swatch change nothing: a property that nothing could be put into would be drawn dimmed."""


def _swatch() -> FloatVectorProperty:
    """Make the property that panels draw the kept colour of a line by."""
    return FloatVectorProperty(name="Colour", subtype="COLOR", size=3, min=0.0, max=1.0, get=_kept, set=_keep_as_it_is)


def _colour() -> FloatVectorProperty:
    """Make the property that keeps the colour of a line."""
    return FloatVectorProperty(subtype="COLOR", size=3, min=0.0, max=1.0)


class SachaFact(bpy.types.PropertyGroup):
    """One thing worth knowing of what is shown; `name` says it."""


class SachaLegendLine(bpy.types.PropertyGroup):
    """One line of a legend; `name` is its label."""

    kept: _colour()
    colour: _swatch()


class SachaRegionNumber(bpy.types.PropertyGroup):
    """What a view says of a whole region; `name` is the number as people read it."""

    value: FloatProperty()
    known: BoolProperty()
    level: IntProperty(min=0)
    kept: _colour()
    colour: _swatch()


class SachaView(bpy.types.PropertyGroup):
    """One way of looking at the triangles; `name` is that of the attribute with its numbers."""

    label: StringProperty()
    unit: StringProperty()
    about: StringProperty()
    palette: StringProperty()
    legend: CollectionProperty(type=SachaLegendLine)
    by_region: CollectionProperty(type=SachaRegionNumber)


class SachaRegion(bpy.types.PropertyGroup):
    """One row of the table of regions; `name` is the region's."""

    place: IntProperty(min=0, description="Number of the region in the attribute `region`")
    kept: _colour()
    colour: _swatch()
    triangles: IntProperty(min=0)
    area_cm2: FloatProperty(min=0.0)
    gaussians: IntProperty(min=0)
    share: FloatProperty(min=0.0, max=1.0)
    n_bytes: IntProperty(min=0)
    bytes_each: FloatProperty(min=0.0)
    before: IntProperty(min=0)
    before_share: FloatProperty(min=0.0, max=1.0)
    change: IntProperty()
    before_bytes: IntProperty(min=0)
    bytes_change: IntProperty()


class SachaShown(bpy.types.PropertyGroup):
    """What a mesh shows, kept with the mesh."""

    source: StringProperty(name="Source", description="The file that this was opened from", subtype="FILE_PATH")
    kind: StringProperty(name="Kind")
    head: StringProperty(name="Head", description="The head model that it is bound to")
    scheme: StringProperty(name="Scheme", description="How the head is divided into regions")
    compared: StringProperty(
        name="Compared With", description="The avatar that changes are told against", subtype="FILE_PATH"
    )
    n_faces: IntProperty(name="Triangles", description="How many triangles were opened", min=0)
    facts: CollectionProperty(type=SachaFact)
    absent: CollectionProperty(type=SachaFact)
    views: CollectionProperty(type=SachaView)
    view: EnumProperty(
        name="View", description="What the colours of the triangles say", items=_views, update=_view_changed
    )
    by: EnumProperty(
        name="By",
        description="Whether each triangle has the colour of its own number or of its region's",
        items=[
            ("TRIANGLE", "Triangle", "Each triangle has the colour of its own number"),
            ("REGION", "Region", "Each triangle has the colour of its region's number, with hard borders"),
        ],
        update=_view_changed,
    )
    regions: CollectionProperty(type=SachaRegion)
    active_region: IntProperty(
        name="Region", description="Selects the faces of the region", default=-1, update=_region_chosen
    )
    before_name: StringProperty(name="Before", description="What `before` is; empty where nothing is known of it")
    columns: StringProperty(description="Columns of the table that there are numbers for, with spaces between them")
    table: EnumProperty(
        name="Table", description="Which numbers the table of regions has", items=[entry[:3] for entry in TABLES]
    )
    sort_by: EnumProperty(
        name="Sort By", description="What rows are sorted by", items=[(name, *rest) for name, *rest in SORTS]
    )
    sort_down: BoolProperty(name="Largest First", description="The largest number comes first")

    def shown_view(self) -> SachaView | None:
        """Give the view that is chosen; None where there is none."""
        return self.views.get(self.view.lower())


CLASSES = (SachaFact, SachaLegendLine, SachaRegionNumber, SachaView, SachaRegion, SachaShown)


def attach() -> None:
    """Give meshes what they show."""
    bpy.types.Mesh.sacha = PointerProperty(type=SachaShown)


def detach() -> None:
    """Take it away again."""
    del bpy.types.Mesh.sacha


def shown_by(context: bpy.types.Context) -> SachaShown | None:
    """Give what the active mesh shows, or None where it is not ours."""
    mesh = mesh_of(context)
    return None if mesh is None else mesh.sacha


def edited(mesh: bpy.types.Mesh) -> str:
    """Say that a mesh no longer has the triangles that were opened; empty where it has as many."""
    if len(mesh.polygons) == mesh.sacha.n_faces:
        return ""
    return (
        f"The mesh has {len(mesh.polygons):,} faces now and had {mesh.sacha.n_faces:,} when it was opened: colours follow what is left, "
        "legends and tables are of the whole"
    )
