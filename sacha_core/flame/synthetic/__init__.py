"""The synthetic head: a FLAME-shaped stand-in made by code and a seed, needing no licensed file and derived from none.

`spline` and `sizes` are the ground; `loft` draws the head, `relief` the face on it; `layout` says how it is meshed, `eyes`, `mouth`
and `ears` fill in the openings, `anatomy` puts all together; `identity`, `expressions` (from `fields` and `lids`), `skinning` and
`correctives` make it move, `masks` name its regions, and `head` hands it out.
"""

from sacha_core.flame.synthetic.expressions import EXPRESSIONS
from sacha_core.flame.synthetic.head import head_parts, synthetic_head
from sacha_core.flame.synthetic.identity import IDENTITY

__all__ = ["EXPRESSIONS", "IDENTITY", "head_parts", "synthetic_head"]
