"""What an add-on can leave behind in Blender: classes, operators, handlers, menu entries, keys, properties, names for drivers."""

from __future__ import annotations

import bpy

__all__ = ["traces"]

# Types that add-ons give properties to: everything that is saved in a .blend, and what is not saved but holds state.
OTHER_HOLDERS = ("WindowManager", "Bone", "PoseBone", "ViewLayer", "AddonPreferences", "Screen", "Space")


def traces() -> dict[str, set[str]]:
    """Give, by kind, what is there now."""
    return {
        "types": set(dir(bpy.types)),
        "classes": {kind.__name__ for kind in all_kinds() if getattr(kind, "is_registered", False)},
        "operators": set(dir(bpy.ops.sacha)),
        "handlers": {f"{name}: {named(one)}" for name, ours in handlers().items() for one in ours},
        "menu entries": {f"{kind.__name__}: {named(one)}" for kind in all_kinds() for one in entries(kind)},
        "keys": {f"{keys.name}: {item.idname}" for keys in addon_keymaps() for item in keys.keymap_items},
        "properties": {f"{holder}.{name}" for holder in holders() for name in properties(holder)},
        "names for drivers": set(bpy.app.driver_namespace),
    }  # fmt: skip


def all_kinds() -> set[type]:
    """Give every class that Blender was ever told of, and its own."""
    bases = (bpy.types.Operator, bpy.types.Panel, bpy.types.Menu, bpy.types.Header, bpy.types.UIList)
    bases += (bpy.types.PropertyGroup, bpy.types.AddonPreferences)
    return {kind for base in bases for kind in [*base.__subclasses__(), *of_blender(base)]}


def of_blender(base: type) -> list[type]:
    return [kind for name in dir(bpy.types) if isinstance(kind := getattr(bpy.types, name), type) and issubclass(kind, base)]  # fmt: skip


def handlers() -> dict[str, list]:
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    return {name: ours for name, ours in lists.items() if isinstance(ours, list)}


def entries(kind: type) -> list:
    """Give the functions that were appended to a menu or panel."""
    return list(getattr(getattr(kind, "draw", None), "_draw_funcs", []))


def addon_keymaps() -> list:
    configured = bpy.context.window_manager.keyconfigs.addon  # None in background
    return [] if configured is None else list(configured.keymaps)


def holders() -> list[str]:
    ids = [kind.__name__ for kind in bpy.types.ID.__subclasses__() if hasattr(bpy.types, kind.__name__)]
    return [*ids, *(name for name in OTHER_HOLDERS if hasattr(bpy.types, name))]


def properties(holder: str) -> list[str]:
    return list(getattr(bpy.types, holder).bl_rna.properties.keys())


def named(one: object) -> str:
    return f"{getattr(one, '__module__', '')}.{getattr(one, '__qualname__', one)}"
