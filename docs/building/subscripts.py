"""Symbols in the text of pages, such as T_in, with their subscripts; code stays as it is written."""

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.transforms.post_transforms import SphinxPostTransform

from tssgeom.view.quantities import SYMBOL

_CODE = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.raw, nodes.comment)


class Subscripts(SphinxPostTransform):
    """Writes the letters after the underscore of a symbol below its line."""

    default_priority = 800

    def run(self, **kwargs: Any) -> None:
        """Replace each text that holds a symbol."""
        for text in list(self.document.findall(nodes.Text)):
            parts = _parts(str(text))
            if len(parts) > 1 and not _in_code(text):
                text.parent.replace(text, parts)


def _in_code(node: nodes.Node) -> bool:
    return node is not None and (isinstance(node, _CODE) or _in_code(node.parent))


def _parts(text: str) -> list[nodes.Node]:
    parts, begin = list[nodes.Node](), 0
    for symbol in SYMBOL.finditer(text):
        below = f"{symbol[2]}{symbol[3] or ''}"
        parts += [nodes.Text(text[begin : symbol.end(1)]), nodes.subscript(below, below)]
        begin = symbol.end()
    return [*parts, nodes.Text(text[begin:])]


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the transform to Sphinx."""
    app.add_post_transform(Subscripts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
