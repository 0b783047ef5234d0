"""An avatar or a head as plain arrays, for programs that only show them, such as the Blender add-on."""
