"""What `sacha encode` does with its options: by rules or by rendering, at a level or towards a target, fitted or as it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from sacha_core.errors import HeadError, OptionError

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float, Int

    from sacha_core.avatar.avatar import Avatar
    from sacha_core.cli.console import Console
    from sacha_core.cli.encode import Options
    from sacha_core.flame.model import HeadModel
    from sacha_core.train.views import Target

__all__ = ["Made", "make", "require_consistent", "sightless"]

USUAL_LEVEL = 2
LEARNED, MOST_POWER = "learned", 16  # weights by what training learnt


class Made(NamedTuple):
    """A file.

    Args:
        data: its bytes.
        psnr_db: against the uncompressed avatar; None where nobody measured it.
        n_trials: encodings that it took.
        is_best: whether a size was asked for that is more than even the highest quality takes.
    """

    data: bytes
    psnr_db: float | None = None
    n_trials: int = 1
    is_best: bool = False


def require_consistent(options: Options) -> None:
    """Check that options do not contradict each other.

    Raises:
        OptionError: naming the first two that do.
    """
    targets = {"--target-size": options.target_size, "--target-psnr": options.target_psnr}
    given = [name for name, value in targets.items() if value is not None]
    fitting = "--dataset" if options.dataset is not None else "--tune" if options.tune else None
    if options.tmc3 is not None and options.profile != "paper":
        raise OptionError("--tmc3 codes the paper's profile; expected --profile paper with it")
    if options.scheme is not None and not options.weights:
        raise OptionError("--scheme names the regions of --weights; expected --weights REGION=FACTOR beside it")
    if len(given) > 1:
        raise OptionError("expected one of --target-size and --target-psnr, got both")
    if given and options.level != USUAL_LEVEL:
        raise OptionError(f"--level says how good the file is, and so does {given[0]}; expected one of them")
    if options.level == "archive" and options.profile == "paper":
        raise OptionError("the paper's profile has no level archive; expected --level 1, 2, 3 or 4")
    plain = sightless(options) or ("--no-rendering" if options.no_rendering else None)
    for name in (*given, fitting, "--weights" if options.weights else None):
        if name is not None and plain is not None:
            raise OptionError(f"{name} has the encoder look at pictures, which {plain} does not; expected one of them")
    if options.dataset is not None and options.target_psnr is not None:
        raise OptionError(
            "--dataset with --target-psnr is not possible: the file leaves the uncompressed avatar for the capture;"
            " expected a level or --target-size with it"
        )


def sightless(options: Options) -> str | None:
    """Give the option by which a file is coded in a way that never looks at pictures; None where there is none such."""
    return (
        "--profile paper" if options.profile == "paper" else "--level archive" if options.level == "archive" else None
    )


def make(options: Options, avatar: Avatar, head: HeadModel, console: Console) -> Made:
    """Compress as was asked for.

    Raises:
        OptionError: a target is out of reach, or the capture is of another motion.
        SachaError: the avatar cannot be compressed.
    """
    from sacha_core.codec import encode, encode_archive, encode_paper

    if options.level == "archive":
        made = Made(encode_archive(avatar, head=head, embed_head=options.embed_head))
    elif options.profile == "paper":
        made = Made(encode_paper(avatar, options.level, head=head, embed_head=options.embed_head, tmc3=options.tmc3))
    elif options.no_rendering:
        made = Made(encode(avatar, options.level, head=head, embed_head=options.embed_head))
    else:
        require_posable(avatar, head)
        made = make_by_rendering(options, avatar, head, console)
    if (options.measure or made.is_best) and made.psnr_db is None:
        return made._replace(psnr_db=measured(made.data, avatar, head))
    return made


def require_posable(avatar: Avatar, head: HeadModel) -> None:
    """Check that pictures of an avatar in its own motion can be drawn at all.

    Raises:
        HeadError: the motion has components or vertex offsets that the head lacks; without pictures it is coded all the same.
    """
    from sacha_core.flame.posing import Poser

    if avatar.motion is None:
        return
    try:
        Poser(head, avatar.motion)
    except HeadError as error:
        raise type(error)(f"{error}; --no-rendering encodes it without posing the head") from error


def make_by_rendering(options: Options, avatar: Avatar, head: HeadModel, console: Console) -> Made:
    """Compress with an eye on pictures."""
    from sacha_core.codec.levels import MAX_QUALITY
    from sacha_core.rate.encoding import RenderingEncoder
    from sacha_core.rate.judging import Judge
    from sacha_core.rate.target import encode_to_psnr, encode_to_size, parse_size

    factors = region_factors(options.weights, avatar, head, options.scheme)
    if options.tune or options.dataset is not None:
        return fitted(options, avatar, head, factors, console)
    encoder = RenderingEncoder(avatar, head, options.embed_head, factors=factors)
    if options.target_psnr is not None:
        near = encode_to_psnr(encoder, Judge(avatar, head), options.target_psnr, console.report)
        return Made(near.encoded.data, near.psnr_db, near.n_trials)
    if options.target_size is not None:
        reached = encode_to_size(encoder, parse_size(options.target_size), console.report)
        return Made(reached.encoded.data, None, reached.n_trials, reached.encoded.level.quality >= MAX_QUALITY)
    assert options.level != "archive"
    return Made(encoder.encode(options.level).data)


def region_factors(
    weights: Sequence[str] | None, avatar: Avatar, head: HeadModel, own: Path | None = None
) -> Float[np.ndarray, " n"] | None:
    """Give how much an error counts at each Gaussian; None where nothing was said.

    Args:
        weights: REGION=FACTOR, or `learned` with a power.
        avatar: whose Gaussians.
        head: that they are bound to.
        own: a scheme file with the regions that are meant; by default those that the avatar goes by.

    Raises:
        OptionError: a weight is not REGION=FACTOR, or there is no such region.
        HeadError: the head lacks masks, or the file is another head's.
        FormatError: the file is damaged.
        OSError: it cannot be read.
    """
    import numpy as np

    from sacha_core.cli.steering import parsed_weights
    from sacha_core.regions.partition import partition_by
    from sacha_core.regions.scheme import find_scheme
    from sacha_core.regions.scheme_file import read_scheme_file

    if not weights:
        return None
    scheme = partition_by(head, find_scheme(avatar.scheme)) if own is None else read_scheme_file(own, head)
    regions = scheme.labels[avatar.gaussians.binding]
    by_label = np.ones(len(scheme.regions))
    said = [text for text in weights if text.partition("=")[0] != LEARNED]
    for label, factor in parsed_weights(said, scheme).items():
        by_label[label] = factor
    for text in weights:
        if text not in said:
            by_label *= learned_factors(text, avatar, regions, len(by_label))
    return np.asarray(by_label[regions])


def learned_factors(
    text: str, avatar: Avatar, regions: Int[np.ndarray, " n"], n_regions: int
) -> Float[np.ndarray, " r"]:
    """Give by region how much an error counts by what training learnt: one over its modulator, to the power that `text` names.

    Raises:
        OptionError: the power is no number of 0 to 16, or the avatar has no sensitivities.
    """
    import numpy as np

    from sacha_core.avatar.binding import sigmoid
    from sacha_core.density.modulators import modulators
    from sacha_core.density.region_means import region_means

    try:
        power = float(text.partition("=")[2] or 1)
    except ValueError:
        power = -1.0
    if not 0 <= power <= MOST_POWER:
        raise OptionError(f"--weights {text}: expected {LEARNED} or {LEARNED}=POWER with a power of 0 to {MOST_POWER}")
    logits = avatar.gaussians.sensitivity_logit
    if logits is None:
        raise OptionError(f"--weights {text}: the avatar has no sensitivities; a trained model and its archive have")
    return np.asarray(modulators(region_means(sigmoid(logits), regions, n_regions)) ** -power)


def fitted(
    options: Options, avatar: Avatar, head: HeadModel, factors: Float[np.ndarray, " n"] | None, console: Console
) -> Made:
    """Compress fewer Gaussians, fitted so that they make up for those left out and for rounding."""
    from sacha_core.rate.target import parse_size
    from sacha_core.rate.tuned import Tuner

    steps = None if options.dataset is None else capture_steps(options.dataset, avatar)
    tuner = Tuner(avatar, head, embed_head=options.embed_head, steps=steps, factors=factors, report=console.report)
    if options.target_size is None and options.target_psnr is None:
        assert options.level != "archive"
        return Made(tuner.at_level(options.level).data)
    if options.target_psnr is not None:
        reached = tuner.to_psnr(options.target_psnr)
    else:
        assert options.target_size is not None
        reached = tuner.to_size(parse_size(options.target_size))
    return Made(reached.encoded.data, reached.psnr_db, reached.n_trials)


def capture_steps(dataset: Path, avatar: Avatar) -> Sequence[Sequence[Target]]:
    """Give the training pictures of a capture of the avatar's motion.

    Raises:
        OptionError: the avatar has another motion, or none.
        DatasetError: the capture is incomplete.
    """
    from sacha_core.interchange.capture import read_capture
    from sacha_core.rate.pictures import CaptureSteps

    capture = read_capture(dataset)
    frames = 0 if avatar.motion is None else len(avatar.motion)
    if frames != len(capture.motion):
        raise OptionError(
            f"--dataset {dataset} is of {len(capture.motion)} timesteps, the avatar's motion of {frames}; expected the same"
        )
    return CaptureSteps.of(capture)


def measured(data: bytes, avatar: Avatar, head: HeadModel) -> float:
    """Give the PSNR of a file against the uncompressed avatar."""
    from sacha_core.codec import decode
    from sacha_core.rate.judging import Judge

    return Judge(avatar, head).full(decode(data, head=head).gaussians)
