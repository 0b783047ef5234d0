"""The shell command `sacha`: one file for each subcommand."""
