"""Multi-view captures: of a made-up person, drawn by a renderer that is not the model fitted to them, or of an avatar somebody has already.

`options` says what is made, `cameras` from where it is seen. The made-up person performs `sequences`; `landmarks`, `skin`, `hair`, `brows`
and `palette` give a head its appearance (`subject`), `light` shadows it, `renderer` draws it, and `film` puts all together. An avatar acts
(`acting`; `arkit_face`, `arkit_acting` and `tracks` for ARKit's blend shapes) or follows `excerpts` of a motion; `framing` moves the rig to
it, and `avatar_film` puts all together.
"""
