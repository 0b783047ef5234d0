"""An avatar into the bytes of a `.sacha` file.

Source: own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.codec.anchor_search import search_vertices
from sacha_core.codec.anchors import match_vertices
from sacha_core.codec.colour import encode_colour
from sacha_core.codec.container import Section, pack_sections
from sacha_core.codec.counts import encode_layout
from sacha_core.codec.displacement import displacement_products
from sacha_core.codec.harmonic_encoder import encode_harmonics
from sacha_core.codec.harmonic_metric import metric_of
from sacha_core.codec.head import encode_head
from sacha_core.codec.header import Header
from sacha_core.codec.hidden import encode_hidden
from sacha_core.codec.importance import GaussianImportance
from sacha_core.codec.in_turn import Remaining, encode_in_turn, for_coding_in_turn
from sacha_core.codec.levels import Level, level_named
from sacha_core.codec.motion_writer import encode_motion
from sacha_core.codec.opacity import encode_opacity, opacity_index, opacity_table
from sacha_core.codec.order import layout_by_triangle, layout_by_vertex
from sacha_core.codec.plan import Plan, Prepared, plan_by_rules, plan_by_worth
from sacha_core.codec.position import encode_position
from sacha_core.codec.rotation import encode_rotation, sort_axes
from sacha_core.codec.scale import classes_of, encode_scale, known_classes, scales_in_triangles
from sacha_core.codec.static import encode_static
from sacha_core.codec.template import Template, template_of, unknown_template
from sacha_core.errors import FormatError, MissingHeadError, OptionError, TopologyError
from sacha_core.flame.model import HeadModel

__all__ = ["GROUP_FRAMES", "Recolour", "encode", "encode_traced", "price_of_a_bit"]

# gives colours of degree 0 to code, (m, 3), for Gaussians otherwise as the decoder will have them, and the row that each was given in
Recolour = Callable[[Gaussians, Int[np.ndarray, " m"]], Float[np.ndarray, "m 3"]]

GROUP_FRAMES = 50  # 2 s at 25 frames a second; of 100 they cost as much
VISIBLE = np.log((1 / 255) / (1 - 1 / 255))  # rasterisers skip what covers less than one step of 8 bits
MAX_POSITION = 2.0**15  # triangle units; real avatars stay below 100
MIN_LOG_SCALE, MAX_LOG_SCALE = -40.0, 40.0
MAX_COLOUR = 2.0**12
BOUNDS = {"position": MAX_POSITION, "sh_dc": MAX_COLOUR, "sh_rest": MAX_COLOUR}
SCALE_FLOOR_AXES = (1, 2)


def encode(
    avatar: Avatar,
    level: int | Level = 2,
    *,
    head: HeadModel | None = None,
    embed_head: bool = False,
    drop_invisible: bool = True,
    group_frames: int = GROUP_FRAMES,
    importance: GaussianImportance | None = None,
) -> bytes:
    """Compress an avatar.

    Args:
        avatar: what to compress; its sensitivity logits are not sent.
        level: 1 (smallest) to 4 (best), or a `Level` of one's own (`levels.level_at`).
        head: the head model that it is bound to. With it, neighbours on the head predict each other and steps are meant in metres, which
            saves about a fifth; decoding then needs the head as well. Without it, decoding needs nothing.
        embed_head: add the head model itself to the file.
        drop_invisible: leave out Gaussians whose opacity is, or decodes to, less than 1/255, which no renderer draws.
        group_frames: frames in a group of the motion, at whose starts decoding can begin (1 to 65535).
        importance: what every number is worth to pictures, as `sacha_core.rate` measures it; None to go by the rules of the level alone.

    Returns:
        The bytes of the file; the same avatar and options give the same bytes.

    Raises:
        FormatError: the avatar or its importance is not finite, bound outside its head, or has values beyond what the format holds.
        HeadError: `head` is not the one that the avatar names, or is missing where it shall be embedded.
        OptionError: an option is out of range.
    """
    coded, _ = encode_traced(
        avatar,
        level,
        head=head,
        embed_head=embed_head,
        drop_invisible=drop_invisible,
        group_frames=group_frames,
        importance=importance,
    )
    return coded


def encode_traced(
    avatar: Avatar,
    level: int | Level = 2,
    *,
    head: HeadModel | None = None,
    embed_head: bool = False,
    drop_invisible: bool = True,
    group_frames: int = GROUP_FRAMES,
    importance: GaussianImportance | None = None,
    recolour: Recolour | None = None,
    remaining: Remaining | None = None,
    template: Template | None = None,
) -> tuple[bytes, Int[np.ndarray, " m"]]:
    """Compress an avatar as `encode` does; give the bytes, and which of its Gaussians each of the m decoded ones is.

    `recolour` chooses colours when all else is decided, to make up for what that lost; None keeps them. `remaining` moves all that is not
    coded yet after each attribute, and wants to know the importance; colours are its own then. `template` is that of the head, where it
    is at hand.
    """
    chosen = level if isinstance(level, Level) else level_named(level)
    if not isinstance(group_frames, (int, np.integer)) or not 1 <= group_frames <= 65535:
        raise OptionError(f"group_frames is {group_frames!r}, expected a whole number from 1 to 65535")
    check_head(avatar, head, embed_head)
    avatar.gaussians.validate(avatar.head.n_faces)
    gaussians = avatar.gaussians
    if importance is not None:
        importance.validate(len(gaussians), gaussians.sh_rest.shape[1])
    keep = np.ones(len(gaussians), bool)
    if drop_invisible:
        keep = visible(gaussians.opacity_logit, chosen.opacity_steps)
    check_range(gaussians, keep)
    gaussians = gaussians.select(keep)
    importance = importance if importance is None or keep.all() else importance.select(keep)
    if template is None:
        template = template_of(head.v_template, head.faces) if head else unknown_template(avatar.head.n_faces)
    rows = np.flatnonzero(keep)
    mine = None if recolour is None else lambda decoded, order: recolour(decoded, rows[order])
    sections, order = encode_gaussians(gaussians, template, chosen, importance, head, mine, remaining)
    made = (chosen.number, len(gaussians), gaussians.sh_degree, avatar.head, avatar.scheme)
    header = Header(*made, needs_head=head is not None)
    if avatar.motion is not None:
        header, motion_sections = add_motion(header, avatar, chosen, group_frames, head, template)
        sections = [motion_sections[0], *sections, motion_sections[1]]
    if embed_head and head is not None:
        sections.append(Section("head", encode_head(head)))
    return pack_sections(pad([Section("Header", header.pack()), *sections], header)), rows[order]


def check_head(avatar: Avatar, head: HeadModel | None, embed_head: bool) -> None:
    """Check that `head` is the avatar's, and there where it is to be embedded."""
    if embed_head and head is None:
        raise MissingHeadError(f"to embed the head {avatar.head.name!r} it has to be given")
    if head is not None and replace(head.reference, name=avatar.head.name) != avatar.head:
        named = [
            f"{reference.name!r} ({reference.n_faces} triangles, SHA-256 {reference.sha256[:12]}...)"
            for reference in (avatar.head, head.reference)
        ]
        raise TopologyError(f"the avatar is bound to head {named[0]}, another one, {named[1]}, was given")


def visible(opacity_logit: Float[np.ndarray, " n"], n_steps: int) -> Bool[np.ndarray, " n"]:
    """Tell which Gaussians a renderer draws, as they are and as they will be decoded."""
    decoded = opacity_table(n_steps).logit[opacity_index(opacity_logit, n_steps)]
    return np.asarray((opacity_logit >= VISIBLE) & (decoded >= VISIBLE))


def check_range(gaussians: Gaussians, keep: Bool[np.ndarray, " n"]) -> None:
    """Check that values of the Gaussians to be kept are within what the format holds.

    Raises:
        FormatError: naming the attribute, the row of the first offender and the range.
    """
    for name, bound in BOUNDS.items():
        value = np.abs(getattr(gaussians, name))
        largest = value.max(axis=tuple(range(1, value.ndim)), initial=0)
        outside = keep & (largest > bound)
        if outside.any():
            row = int(np.argmax(outside))
            raise FormatError(f"{name} of Gaussian {row} is {largest[row]:g}; the format holds up to {bound:g}")


def encode_gaussians(
    gaussians: Gaussians,
    template: Template,
    level: Level,
    importance: GaussianImportance | None = None,
    head: HeadModel | None = None,
    recolour: Recolour | None = None,
    remaining: Remaining | None = None,
) -> tuple[list[Section], Int[np.ndarray, " n"]]:
    """Code all attributes, each after those that its steps follow; give the sections, and the row of each Gaussian in coding order."""
    prepared, importance, order = prepare(gaussians, template, level, importance)
    plan = plan_by_rules(prepared, level)
    if importance is not None and len(order):
        plan = plan_by_worth(prepared, level, importance, plan)
    counts = encode_layout(prepared.numbers, template, prepared.by_vertex)
    if remaining is not None and importance is not None and len(order):
        sections = encode_in_turn(prepared, for_coding_in_turn(plan), head, importance, remaining)
    else:
        mine = None if recolour is None or not len(order) else lambda decoded: recolour(decoded, order)
        sections = encode_planned(prepared, plan, head, importance, mine)
    return [Section("Counts", counts), *sections], order


def price_of_a_bit(
    gaussians: Gaussians, template: Template, level: int | Level, importance: GaussianImportance
) -> float:
    """Give the squared error in pictures, in units of `importance`, that a level trades for a bit; 0 where nothing is coded."""
    chosen = level if isinstance(level, Level) else level_named(level)
    keep = visible(gaussians.opacity_logit, chosen.opacity_steps)
    alone = replace(importance, colour_metric=None)  # which decides nothing here, and is the largest part
    prepared, known, order = prepare(gaussians.select(keep), template, chosen, alone.select(keep))
    if known is None or not len(order):
        return 0.0
    return plan_by_worth(prepared, chosen, known, plan_by_rules(prepared, chosen)).price or 0.0


def prepare(
    gaussians: Gaussians, template: Template, level: Level, importance: GaussianImportance | None
) -> tuple[Prepared, GaussianImportance | None, Int[np.ndarray, " n"]]:
    """Give Gaussians in coding order, their importance, and the row of each."""
    index = opacity_index(gaussians.opacity_logit, level.opacity_steps)
    if importance is not None:
        importance = importance.with_axes(np.argsort(-gaussians.log_scale, axis=1, kind="stable"))
    log_scale, quaternion = sort_axes(gaussians.log_scale, gaussians.quaternion)
    log_scale = raise_thin_axes(log_scale, level.max_thinness)
    place, by_vertex = places_of(gaussians, template)
    order = np.lexsort((*gaussians.position.T, *log_scale.T[::-1], -index, place))
    gaussians, index, log_scale, quaternion = gaussians.select(order), index[order], log_scale[order], quaternion[order]
    importance = None if importance is None else importance.select(order)
    numbers = np.bincount(place, minlength=len(template.vertices if by_vertex else template.triangles)).astype(np.int64)
    layout = layout_by_vertex(numbers > 0, template) if by_vertex else layout_by_triangle(numbers, template)
    return Prepared(layout, gaussians, index, log_scale, quaternion, numbers, by_vertex), importance, order


def encode_planned(
    prepared: Prepared,
    plan: Plan,
    head: HeadModel | None = None,
    importance: GaussianImportance | None = None,
    recolour: Callable[[Gaussians], Float[np.ndarray, "n 3"]] | None = None,
) -> list[Section]:
    """Code all attributes as planned."""
    layout, gaussians, worth = prepared.layout, prepared.gaussians, plan.worth
    opacity, index = encode_opacity(
        layout,
        opacity_index(gaussians.opacity_logit, plan.opacity_steps),
        plan.opacity_steps,
        plan.hidden,
        plan.opacity_weight,
    )
    known = known_classes(opacity_table(plan.opacity_steps).transparency[index], plan.hidden)
    scale, scale_values = encode_scale(layout, prepared.log_scale, known, plan.scale, worth["scale"])
    classes = classes_of(known, scale_values)
    rotation = encode_rotation(layout, prepared.quaternion, classes, plan.rotation, worth["rotation"])
    position = encode_position(layout, gaussians.position, classes, plan.position, worth["position"])
    harmonic, sh_dc, sh_rest = [], gaussians.sh_dc, gaussians.sh_rest
    if gaussians.sh_degree:
        metric = metric_of(gaussians, head, importance, plan.harmonic, classes)
        coded, sh_rest = encode_harmonics(layout, gaussians.sh_rest, classes, plan.harmonic, metric, plan.price)
        harmonic, sh_dc = [Section("Harmonic", coded)], metric.folded(gaussians.sh_dc, gaussians.sh_rest - sh_rest)
    if recolour is not None:
        decoded = Gaussians(
            position=position[1],
            log_scale=scales_in_triangles(layout, scale_values),
            quaternion=rotation[1],
            opacity_logit=opacity_table(plan.opacity_steps).logit[index],
            sh_dc=np.asarray(sh_dc, np.float32),
            sh_rest=np.asarray(sh_rest, np.float32),
            binding=layout.binding,
        )
        sh_dc = recolour(decoded)
    return [
        Section("Hidden", encode_hidden(layout, plan.hidden)),
        Section("Opacity", opacity),
        Section("Scale", scale),
        Section("Rotation", rotation[0]),
        Section("Position", position[0]),
        Section("Colour", encode_colour(layout, sh_dc, classes, plan.colour, worth["colour"])[0]),
        *harmonic,
    ]


def places_of(gaussians: Gaussians, template: Template) -> tuple[Int[np.ndarray, " n"], bool]:
    """Give the place of each Gaussian in coding order, and whether places are vertices rather than triangles."""
    vertices = match_vertices(gaussians.binding, template)
    if vertices is None:
        vertices = search_vertices(gaussians.binding, gaussians.position, template)
    if vertices is None:
        return np.argsort(template.order)[gaussians.binding], False
    return vertices, True


def raise_thin_axes(log_scale: Float[np.ndarray, "n 3"], max_thinness: float) -> Float[np.ndarray, "n 3"]:
    """Raise each scale to no less than `max_thinness` below the next larger one: what is thinner looks the same."""
    floored = np.clip(log_scale.astype(np.float64), MIN_LOG_SCALE, MAX_LOG_SCALE)
    for axis in SCALE_FLOOR_AXES:
        floored[:, axis] = np.maximum(floored[:, axis], floored[:, axis - 1] - max_thinness)
    return floored


def add_motion(
    header: Header, avatar: Avatar, level: Level, group_frames: int, head: HeadModel | None, template: Template
) -> tuple[Header, list[Section]]:
    """Code the motion; give the header that tells of it, and its static and its dynamic section.

    With a head, steps of the frames are chosen by how far they move its vertices.

    Raises:
        FormatError: the motion is not finite, inconsistent, or beyond what the format holds.
    """
    motion = avatar.motion
    assert motion is not None
    motion.validate()
    told = header.telling(motion)
    check_offsets(told)
    try:
        static = encode_static(motion.shape, motion.static_offset, level.shape_step, level.offset_step, template)
        products = None if head is None else displacement_products(head, motion)
        dynamic = encode_motion(motion, level, group_frames, products)
    except OverflowError as fault:
        raise FormatError(f"motion: {fault}") from fault
    return told, [Section("Static", static), Section("Motion", dynamic)]


def check_offsets(header: Header) -> None:
    """Check that every vertex of the head has an offset, or none.

    Raises:
        FormatError: some have.
    """
    if header.n_offsets not in (0, header.head.n_vertices):
        raise FormatError(f"{header.n_offsets} vertex offsets, the head has {header.head.n_vertices} vertices")


def pad(sections: list[Section], header: Header) -> list[Section]:
    """Add a section of zeros where the file would be smaller than what it says may be."""
    missing = header.missing_bytes(len(pack_sections(sections)))
    return [*sections, Section("padding", bytes(missing))] if missing > 0 else sections
