"""Fitting an avatar to a capture; torch begins here."""
