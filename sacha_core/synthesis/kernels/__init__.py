"""Compiled loops of the ground-truth renderer: numpy arrays in and out, serial, and free of the interpreter lock."""
