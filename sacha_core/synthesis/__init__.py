"""Multi-view captures of a made-up person, drawn by a renderer that is not the model fitted to them.

`options` and `sequences` say what is performed, `cameras` from where it is seen; `landmarks`, `skin`, `hair`, `brows` and `palette` give a
head its appearance (`subject`), `light` shadows it, `renderer` draws it, and `film` puts all together.
"""
