"""Pages that need no other file: one style, and parts filled into a template."""

from __future__ import annotations

import re
from importlib.resources import files
from string import Template

from tssgeom.view import colours
from tssgeom.view.figures.style import FIXED
from tssgeom.view.quantities import SYMBOL


def filled(template: str, **parts: str) -> str:
    """Return a page: a template of this folder with the common style and its parts filled in."""
    here = files("tssgeom.view.report")
    style = here.joinpath("page.css").read_text("utf-8") + _dark_pictures("".join(parts.values()))
    return Template(here.joinpath(template).read_text("utf-8")).substitute(style=style, **parts)


def _dark_pictures(markup: str) -> str:
    """Return the rules that give each colour of the pictures in a page its counterpart on a dark screen."""
    rules = list[str]()
    for kind, colour in sorted(set(_COLOUR.findall(markup))):
        dark = colours.on_dark(colour)
        if dark != colour:
            as_style = f'[style*="{kind}: {colour}"]:not([id="{FIXED}"] *)'
            rules.append(f'[{kind}="{colour}"], {as_style} {{ {kind}: {dark} !important; }}')
    return "@media screen and (prefers-color-scheme: dark) {\n" + "\n".join(rules) + "\n}\n"


_COLOUR = re.compile(r'(stroke|fill)(?:="|: )(#[0-9a-f]{6})')


def with_subscripts(markup: str) -> str:
    """Write `T_in` in the markup of a page as a symbol with its subscript."""
    return SYMBOL.sub(lambda symbol: f"{symbol[1]}<sub>{symbol[2]}{symbol[3] or ''}</sub>", markup)
