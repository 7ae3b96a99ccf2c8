"""The fields of a class in its help: the text below each in the source, read when the help is asked for."""

from __future__ import annotations

from typing import Any


class WithFields:
    """The docstring of a class, followed by its fields; reading the source waits until somebody reads it."""

    def __init__(self, summary: str | None) -> None:
        self.summary = summary or ""

    def __get__(self, instance: object, owner: type) -> str:
        from inspect import cleandoc

        fields = documented_fields(owner)
        if not fields:
            return self.summary
        lines = [f"{name}\n    {text}" for name, text in fields.items()]
        return "\n".join([cleandoc(self.summary), "", "Attributes", "----------", *lines, ""])


def documented_fields(owner: Any) -> dict[str, str]:
    """Return the fields of a class and of those above it, each with the text below it in the source."""
    import ast
    import inspect
    import textwrap

    fields = dict[str, str]()
    for base in reversed(owner.__mro__):
        if not base.__module__.startswith("tssgeom.") or "__annotations__" not in base.__dict__:
            continue
        try:
            body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
        except (OSError, TypeError):  # no source is installed
            continue
        statements = body.body if isinstance(body, ast.ClassDef) else []
        for node, below in zip(statements, [*statements[1:], None], strict=True):
            if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
                continue
            name, text = node.target.id, ""
            if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
                text = " ".join(str(below.value.value).split())
            if not name.startswith("_") and "ClassVar" not in ast.unparse(node.annotation):
                fields[name] = text
    return fields
