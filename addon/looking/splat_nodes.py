# SPDX-License-Identifier: GPL-3.0-or-later
"""The geometry nodes that let splats follow a head and show them as ellipsoids: they go on working where the add-on is missing.

Each splat takes the frame of the triangle that carries it (first edge, normal, and their cross product; scale the mean of the edge's length
and the height over it; origin the centroid), as the engine does, from the head as it is now. Where the head has other triangles than it
had, splats stay where the engine put them.
"""

from __future__ import annotations

from typing import Any

import bpy

from . import splat_materials

__all__ = ["MODIFIER", "SOFT_RADIUS", "add_modifier", "apply"]

MODIFIER = "SACHA Splats"
GROUP, NATIVE_GROUP = "SACHA Splats", "SACHA Splats (native)"
VERSION, VERSION_KEY = (
    1,
    "sacha_version",
)  # of the trees below: .blend files keep older ones, and so do objects that use them
SOFT_RADIUS = splat_materials.RADIUS
MANY = 30_000  # solid splats: beyond, half the corners each, so that playing stays fluid

Socket = bpy.types.NodeSocket
SETTINGS = (
    ("Head", "NodeSocketObject", "head"),
    ("Triangles", "NodeSocketInt", "n_faces"),
    ("Follow", "NodeSocketBool", "follow"),
    ("Size", "NodeSocketFloat", "size"),
    ("Least Opacity", "NodeSocketFloat", "least_opacity"),
    ("Soft", "NodeSocketBool", "soft"),
)


def add_modifier(splats: bpy.types.Object, *, native: bool) -> None:
    """Let an object of splats follow its head; `native` where Blender draws splats itself and needs no ellipsoids."""
    modifier = splats.modifiers.get(MODIFIER) or splats.modifiers.new(MODIFIER, "NODES")
    modifier.node_group = _group(NATIVE_GROUP if native else GROUP, native)
    apply(splats)


def apply(splats: bpy.types.Object) -> None:
    """Hand an object's settings to its modifier."""
    modifier = splats.modifiers.get(MODIFIER)
    if modifier is None or modifier.node_group is None:
        return
    sockets = {item.name: item.identifier for item in modifier.node_group.interface.items_tree}
    for name, _, setting in SETTINGS:
        if name in sockets:
            modifier[sockets[name]] = getattr(splats.sacha_splats, setting)
    splats.update_tag()


def _group(name: str, native: bool) -> bpy.types.NodeTree:
    """Give the tree of that name, made anew where there is none of this version."""
    for tree in bpy.data.node_groups:
        if tree.name.startswith(name) and tree.get(VERSION_KEY) == (-VERSION if native else VERSION):
            return tree
    tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
    tree[VERSION_KEY] = -VERSION if native else VERSION
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    for label, kind, _ in SETTINGS:
        tree.interface.new_socket(label, in_out="INPUT", socket_type=kind)
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    given = {socket.name: socket for socket in tree.nodes.new("NodeGroupInput").outputs}
    posed = _posed(tree, given)
    shown = posed if native else _shown(tree, given, posed)
    tree.links.new(shown, tree.nodes.new("NodeGroupOutput").inputs[0])
    for place, node in enumerate(tree.nodes):  # nobody should have to untangle them before reading
        node.location = (220 * (place % 12), -260 * (place // 12))
    return tree


def _posed(tree: bpy.types.NodeTree, given: dict[str, Socket]) -> Socket:
    """Put the splats where their triangles are."""
    head = _add(tree, "GeometryNodeObjectInfo", {"Object": given["Head"]}, "Geometry", transform_space="RELATIVE")
    faces = _add(tree, "GeometryNodeAttributeDomainSize", {"Geometry": head}, "Face Count", component="MESH")
    same = _add(
        tree, "FunctionNodeCompare", {"A": faces, "B": given["Triangles"]}, "Result", data_type="INT", operation="EQUAL"
    )
    live = _add(tree, "FunctionNodeBooleanMath", {0: same, 1: given["Follow"]}, "Boolean", operation="AND")
    axes, scale, origin = _frame(tree, head)
    place = _attribute(tree, "position_local", "FLOAT_VECTOR")
    parts = _add(tree, "ShaderNodeSeparateXYZ", {"Vector": place}, None)
    mean = origin
    for axis, name in zip(axes, "XYZ", strict=True):
        along = _add(tree, "ShaderNodeMath", {0: parts[name], 1: scale}, "Value", operation="MULTIPLY")
        mean = _vector(tree, "ADD", mean, _vector(tree, "SCALE", axis, Scale=along))
    turn = _add(
        tree,
        "FunctionNodeAxesToRotation",
        {"Primary Axis": axes[0], "Secondary Axis": axes[1]},
        "Rotation",
        primary_axis="X",
        secondary_axis="Y",
    )
    local = _attribute(tree, "rotation_local", "QUATERNION")
    rotation = _add(
        tree, "FunctionNodeRotateRotation", {"Rotation": local, "Rotate By": turn}, "Rotation", rotation_space="GLOBAL"
    )
    sizes = _vector(tree, "SCALE", _attribute(tree, "scale_local", "FLOAT_VECTOR"), Scale=scale)
    shape = given["Geometry"]
    # rotation and scale first: fields that look at triangles do not look at where splats are, but keep it so
    for name, kind, value in (("rotation", "QUATERNION", rotation), ("scale", "FLOAT_VECTOR", sizes)):
        inputs = {"Geometry": shape, "Selection": live, "Name": name, "Value": value}
        shape = _add(tree, "GeometryNodeStoreNamedAttribute", inputs, "Geometry", data_type=kind, domain="POINT")
    return _add(tree, "GeometryNodeSetPosition", {"Geometry": shape, "Selection": live, "Position": mean}, "Geometry")


def _frame(tree: bpy.types.NodeTree, head: Socket) -> tuple[list[Socket], Socket, Socket]:
    """Give the axes, the scale and the origin of the triangle that carries each splat."""
    first = _add(tree, "ShaderNodeMath", {0: _attribute(tree, "binding", "INT"), 1: 3.0}, "Value", operation="MULTIPLY")
    position = _add(tree, "GeometryNodeInputPosition", {}, "Position")
    corners = []
    for corner in range(3):
        index = _add(tree, "ShaderNodeMath", {0: first, 1: float(corner)}, "Value", operation="ADD")
        inputs = {"Geometry": head, "Value": position, "Index": index}
        corners.append(
            _add(tree, "GeometryNodeSampleIndex", inputs, "Value", data_type="FLOAT_VECTOR", domain="CORNER")
        )
    edge, second = (_vector(tree, "SUBTRACT", corner, corners[0]) for corner in corners[1:])
    across = _vector(tree, "CROSS_PRODUCT", edge, second)
    length, area = (_vector(tree, "LENGTH", vector, output="Value") for vector in (edge, across))
    height = _add(tree, "ShaderNodeMath", {0: area, 1: length}, "Value", operation="DIVIDE")
    both = _add(tree, "ShaderNodeMath", {0: length, 1: height}, "Value", operation="ADD")
    scale = _add(tree, "ShaderNodeMath", {0: both, 1: 0.5}, "Value", operation="MULTIPLY")
    along, normal = (_vector(tree, "NORMALIZE", vector) for vector in (edge, across))
    total = _vector(tree, "ADD", _vector(tree, "ADD", corners[0], corners[1]), corners[2])
    origin = _vector(tree, "SCALE", total, Scale=1 / 3)
    return [along, normal, _vector(tree, "CROSS_PRODUCT", along, normal)], scale, origin


def _shown(tree: bpy.types.NodeTree, given: dict[str, Socket], posed: Socket) -> Socket:
    """Show splats as ellipsoids: soft instances, or solid ones made real, whose colours solid views show."""
    colour = _add(tree, "FunctionNodeSeparateColor", {"Color": _attribute(tree, "color", "FLOAT_COLOR")}, None)
    inputs = {"A": colour["Alpha"], "B": given["Least Opacity"]}
    clear = _add(tree, "FunctionNodeCompare", inputs, "Result", data_type="FLOAT", operation="GREATER_EQUAL")
    many = _add(tree, "GeometryNodeAttributeDomainSize", {"Geometry": posed}, "Point Count", component="MESH")
    many = _add(
        tree, "FunctionNodeCompare", {"A": many, "B": MANY}, "Result", data_type="INT", operation="GREATER_THAN"
    )
    fine, finest = (
        _add(tree, "GeometryNodeMeshIcoSphere", {"Radius": 1.0, "Subdivisions": rounds}, "Mesh") for rounds in (1, 2)
    )
    coarse = _add(tree, "GeometryNodeMeshUVSphere", {"Segments": 4, "Rings": 2, "Radius": 1.0}, "Mesh")
    ball = _add(
        tree, "GeometryNodeSwitch", {"Switch": many, "False": fine, "True": coarse}, "Output", input_type="GEOMETRY"
    )
    solid = _ellipsoids(tree, posed, clear, _made_of(tree, ball, splat_materials.solid()), given["Size"])
    soft = _ellipsoids(tree, posed, clear, _made_of(tree, finest, splat_materials.soft()), SOFT_RADIUS)
    opaque = {name: colour[name] for name in ("Red", "Green", "Blue")} | {"Alpha": 1.0}
    inputs = {"Geometry": solid, "Name": "color", "Value": _add(tree, "FunctionNodeCombineColor", opaque, "Color")}
    solid = _add(
        tree, "GeometryNodeStoreNamedAttribute", inputs, "Geometry", data_type="FLOAT_COLOR", domain="INSTANCE"
    )
    solid = _add(tree, "GeometryNodeRealizeInstances", {"Geometry": solid}, "Geometry")
    join = tree.nodes.new("GeometryNodeJoinGeometry")  # with the points, whose mesh knows which colours are to be shown
    for part in (solid, posed):
        tree.links.new(part, join.inputs[0])
    inputs = {"Switch": given["Soft"], "False": join.outputs[0], "True": soft}
    return _add(tree, "GeometryNodeSwitch", inputs, "Output", input_type="GEOMETRY")


def _made_of(tree: bpy.types.NodeTree, ball: Socket, material: bpy.types.Material) -> Socket:
    return _add(tree, "GeometryNodeSetMaterial", {"Geometry": ball, "Material": material}, "Geometry")


def _ellipsoids(
    tree: bpy.types.NodeTree, points: Socket, chosen: Socket, ball: Socket, radius: Socket | float
) -> Socket:
    """Put a ball on each chosen splat, of a radius in standard deviations."""
    sizes = _vector(tree, "SCALE", _attribute(tree, "scale", "FLOAT_VECTOR"), Scale=radius)
    inputs = {"Points": points, "Selection": chosen, "Instance": ball, "Scale": sizes}
    inputs["Rotation"] = _attribute(tree, "rotation", "QUATERNION")
    return _add(tree, "GeometryNodeInstanceOnPoints", inputs, "Instances")


def _attribute(tree: bpy.types.NodeTree, name: str, kind: str) -> Socket:
    return _add(tree, "GeometryNodeInputNamedAttribute", {"Name": name}, "Attribute", data_type=kind)


def _vector(
    tree: bpy.types.NodeTree, operation: str, *vectors: Socket, output: str = "Vector", **inputs: Any
) -> Socket:
    given = dict(enumerate(vectors)) | inputs
    return _add(tree, "ShaderNodeVectorMath", given, output, operation=operation)


def _add(tree: bpy.types.NodeTree, kind: str, inputs: dict[str | int, Any], output: str | None, **options: Any) -> Any:
    """Add a node: sockets among its inputs are linked, other values set.

    Returns:
        The output of that name; all of them by name where it is None.
    """
    node = tree.nodes.new(kind)
    for name, value in options.items():
        setattr(node, name, value)
    for key, value in inputs.items():
        socket = node.inputs[key] if isinstance(key, int) else _enabled(node.inputs, key)
        if isinstance(value, Socket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    if output is None:
        return {socket.name: socket for socket in node.outputs}
    return _enabled(node.outputs, output)


def _enabled(sockets: Any, name: str) -> Socket:
    """Give the socket of that name that is in use: nodes have one for each type of data."""
    return next(socket for socket in sockets if socket.name == name and socket.enabled)
