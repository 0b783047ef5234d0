"""The .sacha file: container, entropy coding, quantisation, one file for each section of the stream."""
