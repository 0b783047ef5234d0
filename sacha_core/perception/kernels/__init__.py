"""Compiled loops of the image losses: serial over a band of rows, without the interpreter's lock."""
