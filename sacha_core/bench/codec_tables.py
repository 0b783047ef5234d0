"""How a comparison of codecs is set and drawn."""

from __future__ import annotations

from collections.abc import Sequence

from sacha_core.bench.result import Column, Panel, Table

__all__ = ["COMPARED", "comparison_panels", "comparison_tables"]

COMPARED = "Codecs on the same avatars: bytes, pictures and times"


def comparison_tables(equal_db: Sequence[int]) -> tuple[Table, ...]:
    """Give the tables.

    Args:
        equal_db: qualities at which bytes are compared, dB.
    """
    codecs = Table(
        "codecs", "The codecs, and whether they are on this machine.",
        (Column("codec", "codec"), Column("title", "what it is"), Column("state", "state")), ("codec",),
    )  # fmt: skip
    equal = Table(
        "equal",
        "KB at equal PSNR, interpolated between measured points (monotone cubics of the logarithm of bytes), and how many percent fewer "
        "ours takes; BD-rate: mean over the range that both reach, which `overlap` gives in percent of both together.",
        (Column("avatar", "avatar"), Column("codec", "codec"), *(Column(f"kb_{q}", f"{q} dB, KB", 1) for q in equal_db),
         *(Column(f"fewer_{q}", f"ours fewer at {q} dB, %", 1) for q in equal_db), Column("bd_rate", "BD-rate of ours, %", 1),
         Column("overlap", "overlap, %", 0)),
        ("avatar", "codec"),
    )  # fmt: skip
    points = Table(
        "points", "Every operating point; `ours at its PSNR` is read off our own curve.",
        (Column("avatar", "avatar"), Column("codec", "codec"), Column("setting", "setting"), Column("kb", "KB", 1),
         Column("binding_kb", "of it bindings", 1), Column("bindings", "coded as"), Column("psnr", "PSNR, dB", 2),
         Column("lowest_psnr", "worst picture, dB", 2), Column("ssim", "SSIM", 4), Column("flip", "FLIP", 4),
         Column("ours_kb", "ours at its PSNR, KB", 1), Column("fewer_percent", "fewer, %", 1), Column("encode_s", "encode, s", 2),
         Column("decode_s", "decode, s", 2), Column("failure", "failure")),
        ("avatar", "codec", "setting"),
    )  # fmt: skip
    sequence = Table(
        "sequence",
        "A short sequence: one avatar with its motion, or every frame as splats of its own. Splats of the posed avatar flatter the "
        "prediction in time, since they correspond from frame to frame; those trained for each frame (--frames) do not. PSNR: of decoded "
        "against the same uncompressed; to the capture: against what its held-out cameras saw (--dataset), whole pictures.",
        (Column("avatar", "avatar"), Column("splats", "splats"), Column("route", "route"), Column("frames", "frames"),
         Column("kb", "KB", 1), Column("kb_per_frame", "KB a frame", 2), Column("further_bytes", "bytes of a further frame", 0),
         Column("psnr", "PSNR, dB", 2),
                  Column("captured_psnr", "to the capture, dB", 2), Column("encode_s", "encode, s", 1), Column("failure", "failure")),
        ("avatar", "splats", "route"),
    )  # fmt: skip
    return (codecs, equal, points, sequence)


def comparison_panels(names: Sequence[str], codecs: Sequence[str]) -> tuple[Panel, ...]:
    """Give a panel of rate and distortion for each avatar."""
    _ = codecs
    return tuple(
        Panel(name, f"curve {name}", "kb", "psnr", "Gaussians, KB", "PSNR, dB", series="codec", log_y=False)
        for name in names
    )
