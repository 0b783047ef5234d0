"""Compiled loops of training: serial over a fixed range, without the interpreter's lock."""
